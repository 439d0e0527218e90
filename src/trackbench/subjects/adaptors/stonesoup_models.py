"""Sensors as measurement models of Stone Soup."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.types.angle import Bearing, Elevation
from stonesoup.types.array import CovarianceMatrix, StateVector, StateVectors
from stonesoup.types.state import State

from trackbench.base.errors import TrackbenchError
from trackbench.base.types import Array, Scan
from trackbench.subjects.adaptors.reader import ELEVATION, POSITION, Reader

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
