"""A tracker that runs a predictor and an updater of Stone Soup, and the measurement models that it gives them."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any, NamedTuple

import numpy as np
from stonesoup.base import Property
from stonesoup.models.base import TimeInvariantModel
from stonesoup.models.measurement import MeasurementModel
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.predictor.kalman import KalmanPredictor, SqrtKalmanPredictor
from stonesoup.types.angle import Bearing, Elevation
from stonesoup.types.array import CovarianceMatrix, StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import Prediction
from stonesoup.types.state import GaussianState, SqrtGaussianState, State
from stonesoup.updater.kalman import KalmanUpdater

from trackbench.base.errors import InputError, TrackbenchError
from trackbench.base.types import Array, Gaussian, Scan
from trackbench.subjects.adaptors.layout import ELEVATION, POSITION, Reader
from trackbench.subjects.adaptors.options import (
    OWN,
    StoneSoupOptions,
    StoneSoupSensor,
    entry_of_sensor,
    import_named,
    made,
)
from trackbench.subjects.adaptors.tracker import AdaptedTracker, Updated

ANGLES = {"azimuth": Bearing, ELEVATION: Elevation}

#: What each model of Stone Soup measures, in its own order.
MEASURED: dict[str, str | tuple[str, ...]] = {
    "LinearGaussian": POSITION,
    "Cartesian2DToBearing": ("azimuth",),
    "CartesianToBearingRange": ("azimuth", "range"),
    "CartesianToElevationBearing": (ELEVATION, "azimuth"),
    "CartesianToElevationBearingRange": (ELEVATION, "azimuth", "range"),
    "CartesianToBearingRangeRate": ("azimuth", "range", "range_rate"),
    "CartesianToBearingRangeRate2D": ("azimuth", "range", "range_rate"),
    "CartesianToElevationBearingRangeRate": (ELEVATION, "azimuth", "range", "range_rate"),
}
#: Models of whatever the user takes them for; the position is usual.
ANY_ORDER = ("LinearGaussian",)


class SensorMeasurement(NonLinearGaussianMeasurement):  # type: ignore[misc]
    """A sensor of trackbench, as it stands at one scan."""

    reader: Reader = Property(doc="What of the scan is the measurement")
    scan: Scan = Property(doc="The scan")

    @property
    def ndim_meas(self) -> int:
        """``m``"""
        return len(self.reader.names(self.scan))

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        """``(m, ...)`` expected of states ``(n, ...)``, angles as Stone Soup has them."""
        x = np.asarray(state.state_vector, dtype=float)
        return typed(self.reader.expected(x, self.scan), self.reader.names(self.scan)).view(StateVectors)

    def jacobian(self, state: Any, **kwargs: Any) -> Array:
        """``(m, n)`` derivative at a state."""
        return self.reader.slope(float_vector(state), self.scan)


def typed(values: Array, names: Sequence[str]) -> Any:
    """``(m, ...)`` values with angles as objects that Stone Soup wraps."""
    rows = np.asarray(values).astype(object)
    for i, name in enumerate(names):
        if name in ANGLES:
            rows[i] = [ANGLES[name](angle) for angle in rows[i]] if rows.ndim > 1 else ANGLES[name](rows[i])
    return rows


def float_vector(state: Any) -> Array:
    """``(n,)`` the numbers of a state or a measurement."""
    return np.array(state.state_vector, dtype=float).reshape(-1)


def state(x: Array) -> Any:
    """A state of Stone Soup."""
    return State(StateVector(x))


def measured_components(model: Any, measurement: str | Sequence[str] | None) -> str | Sequence[str]:
    """What a model measures, in its order; the user says it of a model that is not known.

    Raises:
        TrackbenchError: it is not known, or the user says something else.
    """
    base = next((base.__name__ for base in type(model).__mro__ if base.__name__ in MEASURED), None)
    if base is None and measurement is None:
        raise TrackbenchError(
            f"measurement: missing: what a {type(model).__name__} measures, in its order, is not known"
        )
    if base is None or base in ANY_ORDER:
        return measurement or MEASURED[ANY_ORDER[0]]
    components = MEASURED[base]
    if measurement is not None and list(measurement) != list(components):
        raise TrackbenchError(f"measurement: a {base} measures {', '.join(components)}, in this order; remove it")
    return components


def model_at_scan(model: Any, scan: Scan) -> Any:
    """The model with the pose and velocity of the sensor at a scan."""
    x, y, yaw = scan.sensor_pose
    changed = copy.copy(model)
    for name, stated in (
        ("translation_offset", (x, y)),
        ("rotation_offset", (0.0, 0.0, yaw)),
        ("velocity", tuple(scan.sensor_velocity)),
    ):
        if hasattr(model, name):
            size = len(getattr(model, name))
            setattr(changed, name, StateVector([*stated, 0.0][:size]))
    return changed


def require_pair(pair: Any, options: StoneSoupOptions) -> tuple[Any, Any, Any]:
    """Predictor, updater and, where there is one, the first state.

    Raises:
        InputError: they are something else, or the options do not fit them.
    """
    kinds: tuple[Any, ...] = (KalmanPredictor, KalmanUpdater, (GaussianState, SqrtGaussianState))
    sizes = isinstance(pair, tuple | list) and len(pair) in (2, 3)
    if not sizes or not all(isinstance(item, kind) for item, kind in zip(pair, kinds, strict=False)):
        what = "a KalmanPredictor, a KalmanUpdater and, where the track starts from it, a GaussianState"
        shown = ", ".join(type(item).__name__ for item in pair) if sizes else type(pair).__name__
        raise InputError(f"pair: {options.pair!r} gives {shown}, not {what}")
    predictor, updater, first = (*pair, None)[:3]
    named = len(options.state)
    if predictor.transition_model.ndim_state != named:
        size = predictor.transition_model.ndim_state
        raise InputError(f"state: names {named} components, but the transition model's state has {size}")
    if first is not None and first.ndim != named:
        raise InputError(f"state: names {named} components, but the first state has {first.ndim}")
    if first is None and (options.initial is None or "other" in options.state):
        why = "initial: own" if options.initial is None else "a component named other"
        raise InputError(f"pair: {options.pair!r} gives no first state (a GaussianState), which {why} needs")
    fixed = _fixed(predictor.transition_model)
    if fixed and options.dt_s is None:
        raise InputError("dt_s: missing: the transition model is time-invariant; say for which interval it holds (s)")
    if not fixed and options.dt_s is not None:
        raise InputError("dt_s: not used: the transition model takes any interval; remove it")
    if updater.measurement_model is None:
        for name, sensor in (options.sensors or {}).items():
            if sensor.measurement_model == OWN:
                raise InputError(f"sensors.{name}.measurement_model: the updater has none of its own; name one")
    return predictor, updater, first


def _fixed(model: Any) -> bool:
    """Whether a transition model, or a part of it, is the same for every interval."""
    return isinstance(model, TimeInvariantModel) or any(_fixed(part) for part in getattr(model, "model_list", ()))


#: Stone Soup's times are dates; this one is 0 s.
EPOCH = datetime(2000, 1, 1)


class Model(NamedTuple):
    """Where a sensor's measurement model comes from; None: trackbench's own."""

    source: Any
    options: StoneSoupSensor


def build_stonesoup(values: Mapping[str, Any]) -> StoneSoupTracker:
    """The tracker that the options describe.

    Raises:
        InputError: they do not fit the pair; says how.
        ValidationError: they are not valid by themselves.
    """
    options = StoneSoupOptions.model_validate(values)
    pair = made("pair", options.pair, options.pair_options, lambda item: isinstance(item, tuple | list))
    return StoneSoupTracker(options, *copy.deepcopy(require_pair(pair, options)))


class StoneSoupTracker(AdaptedTracker):
    """Predicts and updates a Gaussian state of Stone Soup."""

    def __init__(self, options: StoneSoupOptions, predictor: Any, updater: Any, first: Any) -> None:
        super().__init__(options)
        self._predictor, self._updater, self._first = predictor, updater, first
        self._models = {name: self._model_of(name, sensor) for name, sensor in (options.sensors or {}).items()}

    def transition_jacobian(self, x: Array, dt: float) -> Array:
        """``(n, n)`` what the transition model takes for its derivative."""
        return self._product_of_slopes(x, dt)

    def measurement(self, x: Array, scan: Scan) -> Array:
        """``(m,)`` what the measurement model expects of a state ``(n,)``."""
        return np.array(self._model(scan)[0].function(state(x)), dtype=float).reshape(-1)

    def measurement_jacobian(self, x: Array, scan: Scan) -> Array:
        """``(m, n)`` what the measurement model takes for its derivative."""
        return np.asarray(self._model(scan)[0].jacobian(state(x)), dtype=float)

    def _moved(self, x: Array, dt: float) -> Array:
        moved = self._predictor.transition_model.function(state(x), time_interval=timedelta(seconds=dt))
        return np.array(moved, dtype=float).reshape(-1)

    def _slope(self, x: Array, dt: float) -> Array:
        slope = self._predictor.transition_model.jacobian(state(x), time_interval=timedelta(seconds=dt))
        return np.asarray(slope, dtype=float)

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
        return Gaussian(float_vector(belief), np.array(belief.covar, dtype=float))

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

    def _model_of(self, name: str, sensor: StoneSoupSensor) -> Model:
        reference, option = sensor.measurement_model, f"sensors.{name}.measurement_model"
        if reference is None:
            return Model(None, sensor)
        source = self._updater.measurement_model if reference == OWN else import_named(option, reference)
        size = len(self.layout.names)
        if isinstance(source, MeasurementModel):
            if source.ndim_state != size:
                raise InputError(f"{option}: {reference!r} is of a state of {source.ndim_state} components, not {size}")
            try:
                components = measured_components(source, sensor.measurement)
            except TrackbenchError as error:
                raise InputError(f"sensors.{name}.{error}") from None
            if components != POSITION and sensor.pose != OWN and not hasattr(source, "translation_offset"):
                problem = f"{reference!r} cannot be put where the sensor is"
                raise InputError(f"sensors.{name}.pose: {problem}: use pose: own, or a function that is given the scan")
        elif isinstance(source, type) or not callable(source):
            raise InputError(f"{option}: {reference!r} is no MeasurementModel and no function of a scan that gives one")
        elif sensor.pose is not None:
            raise InputError(f"sensors.{name}.pose: not used: {reference!r} is given the scan, and its pose; remove it")
        return Model(source, sensor)

    def _model(self, scan: Scan) -> tuple[Any, Reader]:
        """The measurement model at a scan, and the part of the measurement that it is of."""
        source, options = entry_of_sensor(self._models, scan) if self._models else Model(None, StoneSoupSensor())
        if source is None:
            reader = Reader(self.layout, options.measurement)
            noise = reader.measurement(scan).covariance
            return SensorMeasurement(len(self.layout.names), (), noise, reader=reader, scan=scan), reader
        if isinstance(source, MeasurementModel):
            model = source if options.pose == OWN else model_at_scan(source, scan)
        else:
            model = source(scan)
        reader = Reader(self.layout, measured_components(model, options.measurement))
        if options.states_noise:
            model = copy.copy(model)
            model.noise_covar = CovarianceMatrix(reader.measurement(scan).covariance)
        return model, reader


def _date(time: float) -> datetime:
    return EPOCH + timedelta(seconds=time)


def _kept(belief: Any, time: datetime) -> Any:
    """A state without what it came from, or a track would hold all of its past."""
    if isinstance(belief, SqrtGaussianState):
        return SqrtGaussianState(belief.state_vector, belief.sqrt_covar, timestamp=time)
    return GaussianState(belief.state_vector, belief.covar, timestamp=time)
