"""Sensors as measurement models of Stone Soup, and the checks of a predictor and an updater."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.base import TimeInvariantModel
from stonesoup.models.measurement import MeasurementModel
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.angle import Bearing, Elevation
from stonesoup.types.array import CovarianceMatrix, StateVector, StateVectors
from stonesoup.types.state import GaussianState, SqrtGaussianState, State
from stonesoup.updater.kalman import KalmanUpdater

from trackbench.base.errors import InputError, TrackbenchError
from trackbench.base.types import Array, Scan
from trackbench.subjects.adaptors.layout import ELEVATION, POSITION, Reader
from trackbench.subjects.adaptors.options import OWN, StoneSoupOptions

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
        return self.reader.slope(vector(state), self.scan)


def typed(values: Array, names: Sequence[str]) -> Any:
    """``(m, ...)`` values with angles as objects that Stone Soup wraps."""
    rows = np.asarray(values).astype(object)
    for i, name in enumerate(names):
        if name in ANGLES:
            rows[i] = [ANGLES[name](angle) for angle in rows[i]] if rows.ndim > 1 else ANGLES[name](rows[i])
    return rows


def vector(state: Any) -> Array:
    """``(n,)`` the numbers of a state or a measurement."""
    return np.array(state.state_vector, dtype=float).reshape(-1)


def state(x: Array) -> Any:
    """A state of Stone Soup."""
    return State(StateVector(x))


def measured(model: Any, measurement: str | Sequence[str] | None) -> str | Sequence[str]:
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
    known = MEASURED[base]
    if measurement is not None and list(measurement) != list(known):
        raise TrackbenchError(f"measurement: a {base} measures {', '.join(known)}, in this order; remove it")
    return known


def placed(model: Any, scan: Scan) -> Any:
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


def with_noise(model: Any, noise: Array) -> Any:
    """The model with another covariance of its noise."""
    changed = copy.copy(model)
    changed.noise_covar = CovarianceMatrix(noise)
    return changed


def require_pair(found: Any, options: StoneSoupOptions) -> tuple[Any, Any, Any]:
    """Predictor, updater and, where there is one, the first state.

    Raises:
        InputError: they are something else, or the options do not fit them.
    """
    kinds: tuple[Any, ...] = (KalmanPredictor, KalmanUpdater, (GaussianState, SqrtGaussianState))
    sizes = isinstance(found, tuple | list) and len(found) in (2, 3)
    if not sizes or not all(isinstance(item, kind) for item, kind in zip(found, kinds, strict=False)):
        what = "a KalmanPredictor, a KalmanUpdater and, where the track starts from it, a GaussianState"
        shown = ", ".join(type(item).__name__ for item in found) if sizes else type(found).__name__
        raise InputError(f"pair: {options.pair!r} gives {shown}, not {what}")
    predictor, updater, first = (*found, None)[:3]
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


def require_model(found: Any, option: str, reference: str, size: int) -> Any:
    """A measurement model, or a function of a scan that gives one.

    Raises:
        InputError: it is neither, or of another state.
    """
    if isinstance(found, MeasurementModel):
        if found.ndim_state != size:
            raise InputError(f"{option}: {reference!r} is of a state of {found.ndim_state} components, not {size}")
    elif isinstance(found, type) or not callable(found):
        raise InputError(f"{option}: {reference!r} is no MeasurementModel and no function of a scan that gives one")
    return found


def _fixed(model: Any) -> bool:
    """Whether a transition model, or a part of it, is the same for every interval."""
    return isinstance(model, TimeInvariantModel) or any(_fixed(part) for part in getattr(model, "model_list", ()))
