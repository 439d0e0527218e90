"""A tracker that runs a predictor and an updater of Stone Soup."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from datetime import datetime, timedelta
from typing import Any, NamedTuple

import numpy as np
from stonesoup.models.measurement import MeasurementModel
from stonesoup.predictor.kalman import SqrtKalmanPredictor
from stonesoup.types.array import CovarianceMatrix, StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import Prediction
from stonesoup.types.state import GaussianState, SqrtGaussianState

from trackbench.base.errors import InputError, TrackbenchError
from trackbench.base.types import Array, Gaussian, Scan
from trackbench.subjects.adaptors.layout import POSITION, Reader
from trackbench.subjects.adaptors.options import OWN, StoneSoupOptions, StoneSoupSensor, made, named, of_sensor
from trackbench.subjects.adaptors.stonesoup_models import (
    SensorMeasurement,
    measured,
    placed,
    require_model,
    require_pair,
    state,
    typed,
    vector,
    with_noise,
)
from trackbench.subjects.adaptors.tracker import AdaptedTracker, Updated

#: Stone Soup's times are dates; this one is 0 s.
EPOCH = datetime(2000, 1, 1)


class Model(NamedTuple):
    """Where a sensor's measurement model comes from; None: trackbench's own."""

    given: Any
    options: StoneSoupSensor


def tracker(given: Mapping[str, Any]) -> StoneSoupTracker:
    """The tracker that the options describe.

    Raises:
        InputError: they do not fit the pair; says how.
        ValidationError: they are not valid by themselves.
    """
    options = StoneSoupOptions.model_validate(given)
    found = made("pair", options.pair, options.pair_options, lambda item: isinstance(item, tuple | list))
    return StoneSoupTracker(options, *copy.deepcopy(require_pair(found, options)))


class StoneSoupTracker(AdaptedTracker):
    """Predicts and updates a Gaussian state of Stone Soup."""

    def __init__(self, options: StoneSoupOptions, predictor: Any, updater: Any, first: Any) -> None:
        super().__init__(options)
        self._predictor, self._updater, self._first = predictor, updater, first
        self._models = {name: self._found(name, sensor) for name, sensor in (options.sensors or {}).items()}

    def transition(self, x: Array, dt: float) -> Array:
        """``(n,)`` the state after ``dt``."""
        for interval in self._intervals(dt):
            elapsed = timedelta(seconds=interval)
            x = np.array(self._predictor.transition_model.function(state(x), time_interval=elapsed), dtype=float)
            x = x.reshape(-1)
        return x

    def transition_jacobian(self, x: Array, dt: float) -> Array:
        """``(n, n)`` what the transition model takes for its derivative."""
        slope = np.eye(len(x))
        for interval in self._intervals(dt):
            elapsed = timedelta(seconds=interval)
            model = self._predictor.transition_model
            slope = np.asarray(model.jacobian(state(x), time_interval=elapsed), dtype=float) @ slope
            x = self.transition(x, interval)
        return slope

    def measurement(self, x: Array, scan: Scan) -> Array:
        """``(m,)`` what the measurement model expects of a state ``(n,)``."""
        return np.array(self._model(scan)[0].function(state(x)), dtype=float).reshape(-1)

    def measurement_jacobian(self, x: Array, scan: Scan) -> Array:
        """``(m, n)`` what the measurement model takes for its derivative."""
        return np.asarray(self._model(scan)[0].jacobian(state(x)), dtype=float)

    def _own(self, time: float) -> Any:
        return _kept(self._first, _date(time))

    def _begun(self, belief: Gaussian, time: float) -> Any:
        size = len(self.layout.names)
        own = Gaussian(np.zeros(size), np.zeros((size, size))) if self._first is None else self._gaussian(self._first)
        mean, covariance = self._placed(belief, own)
        if isinstance(self._predictor, SqrtKalmanPredictor):
            return SqrtGaussianState(StateVector(mean), np.linalg.cholesky(covariance), timestamp=_date(time))
        return GaussianState(StateVector(mean), CovarianceMatrix(covariance), timestamp=_date(time))

    def _gaussian(self, belief: Any) -> Gaussian:
        return Gaussian(vector(belief), np.array(belief.covar, dtype=float))

    def _predict(self, belief: Any, elapsed: float) -> Any:
        for interval in self._intervals(elapsed):
            then = belief.timestamp + timedelta(seconds=interval)
            belief = _kept(self._predictor.predict(belief, timestamp=then), then)
        return belief

    def _update(self, belief: Any, scan: Scan) -> Updated:
        model, reader = self._model(scan)
        measurement = StateVector(typed(reader.measurement(scan).mean, reader.names(scan)))
        prediction = Prediction.from_state(belief)
        detection = Detection(measurement, timestamp=belief.timestamp, measurement_model=model)
        posterior = self._updater.update(SingleHypothesis(prediction, detection))
        expected = posterior.hypothesis.measurement_prediction
        innovation = np.array(measurement - expected.state_vector, dtype=float).reshape(-1)
        return Updated(_kept(posterior, belief.timestamp), innovation, np.array(expected.covar, dtype=float))

    def _found(self, name: str, sensor: StoneSoupSensor) -> Model:
        reference, option = sensor.measurement_model, f"sensors.{name}.measurement_model"
        if reference is None:
            return Model(None, sensor)
        given = self._updater.measurement_model if reference == OWN else named(option, reference)
        found = require_model(given, option, reference, len(self.layout.names))
        if isinstance(found, MeasurementModel):
            try:
                taken = measured(found, sensor.measurement)
            except TrackbenchError as error:
                raise InputError(f"sensors.{name}.{error}") from None
            if taken != POSITION and sensor.pose != OWN and not hasattr(found, "translation_offset"):
                what = f"{reference!r} cannot be put where the sensor is"
                raise InputError(f"sensors.{name}.pose: {what}: use pose: own, or a function that is given the scan")
        elif sensor.pose is not None:
            raise InputError(f"sensors.{name}.pose: not used: {reference!r} is given the scan, and its pose; remove it")
        return Model(found, sensor)

    def _model(self, scan: Scan) -> tuple[Any, Reader]:
        """The measurement model at a scan, and the part of the measurement that it is of."""
        given, options = of_sensor(self._models, scan) if self._models else Model(None, StoneSoupSensor())
        if given is None:
            reader = Reader(self.layout, options.measurement)
            noise = reader.measurement(scan).covariance
            return SensorMeasurement(len(self.layout.names), (), noise, reader=reader, scan=scan), reader
        if isinstance(given, MeasurementModel):
            model = given if options.pose == OWN else placed(given, scan)
        else:
            model = given(scan)
        reader = Reader(self.layout, measured(model, options.measurement))
        return with_noise(model, reader.measurement(scan).covariance) if options.states_noise else model, reader


def _date(time: float) -> datetime:
    return EPOCH + timedelta(seconds=time)


def _kept(found: Any, time: datetime) -> Any:
    """A state without what it came from, or a track would hold all of its past."""
    if isinstance(found, SqrtGaussianState):
        return SqrtGaussianState(found.state_vector, found.sqrt_covar, timestamp=time)
    return GaussianState(found.state_vector, found.covar, timestamp=time)
