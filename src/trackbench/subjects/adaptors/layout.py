"""The components of a filter's state, and what of a scan is its measurement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.errors import TrackbenchError, nearest_choices
from trackbench.base.types import COMMON_STATE, Array, Gaussian, Scan
from trackbench.base.units import difference
from trackbench.models.motion import ConstantAcceleration, ConstantTurnRateAcceleration, MotionModel, turning
from trackbench.models.sensors import SENSOR_MODELS

#: A component that trackbench has no name for.
OTHER = "other"
#: The components from which position and velocity follow, in each of the two forms of a state.
TURNING_STATE = ("px", "py", "v", "yaw")
#: The motion models that know every component of their form; only the way from and to Cartesian is used of them.
CARTESIAN = ConstantAcceleration(jerk_sigma_mps3=1.0)
TURNING = ConstantTurnRateAcceleration(jerk_sigma_mps3=1.0, yaw_acceleration_sigma_radps2=1.0)


def problem(names: Sequence[str]) -> str | None:
    """What is wrong with the names of a state's components, None if nothing is."""
    known_names = dict.fromkeys([*CARTESIAN.components, *TURNING.components, OTHER])
    for name in names:
        if name not in known_names:
            return f"there is no component {name!r}: {nearest_choices(name, known_names)}"
        if name != OTHER and names.count(name) > 1:
            return f"{name} is named twice"
    form = CARTESIAN if "vx" in names or "vy" in names else TURNING
    needed = COMMON_STATE if form is CARTESIAN else TURNING_STATE
    missing = [name for name in needed if name not in names]
    if missing:
        either = "px, py and vx, vy (or v, yaw) are needed"
        return f"{either}; {' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
    for name in names:
        if name != OTHER and name not in form.components:
            return f"{name} does not go with {' and '.join(needed[2:])}; name it {OTHER!r} if it is something else"
    return None


class Layout:
    """The components of a state, in the filter's own order."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)
        self.turning = "v" in names
        self.motion: MotionModel = TURNING if self.turning else CARTESIAN
        moving = TURNING_STATE if self.turning else COMMON_STATE
        self._moving = [self.names.index(name) for name in moving]
        shared = [name for name in names if name != OTHER]
        self._own = [self.names.index(name) for name in shared]
        self._theirs = [self.motion.components.index(name) for name in shared]

    def to_cartesian(self, x: Array) -> Array:
        """``(4, ...)`` px, py, vx, vy of a state ``(n, ...)``."""
        moving = x[self._moving]
        return turning.to_cartesian(moving) if self.turning else moving

    def cartesian_jacobian(self, x: Array) -> Array:
        """``(4, n)`` derivative of ``to_cartesian`` at a state ``(n,)``."""
        jacobian = np.zeros((4, len(self.names)))
        jacobian[:, self._moving] = turning.cartesian_jacobian(x[self._moving]) if self.turning else np.eye(4)
        return jacobian

    def cartesian_belief(self, belief: Gaussian) -> Gaussian:
        """px, py, vx, vy of a belief ``(n,)``, ``(n, n)``."""
        mean, covariance = belief
        moving = Gaussian(mean[self._moving], covariance[np.ix_(self._moving, self._moving)])
        return turning.cartesian_belief(moving) if self.turning else moving

    def begun(self, belief: Gaussian, own: Gaussian) -> Gaussian:
        """A belief of ``motion``'s state in the filter's order, the components that it does not know from ``own``."""
        mean, covariance = own.mean.copy(), np.zeros_like(own.covariance)
        other = [i for i in range(len(self.names)) if i not in self._own]
        covariance[np.ix_(other, other)] = own.covariance[np.ix_(other, other)]
        mean[self._own] = belief.mean[self._theirs]
        covariance[np.ix_(self._own, self._own)] = belief.covariance[np.ix_(self._theirs, self._theirs)]
        return Gaussian(mean, covariance)


#: The measurement as the position that it states, in the fixed frame.
POSITION = "position"
#: A component that filters of three dimensions have; here every target is level with the sensor.
ELEVATION = "elevation"


def readable_components() -> tuple[str, ...]:
    """Every component that a published sensor reads."""
    return tuple(dict.fromkeys(name for model in SENSOR_MODELS.loaded().values() for name in model.components))


class Reader(NamedTuple):
    """Takes a measurement out of a scan: the position, the components named, or (None) the whole measurement."""

    layout: Layout
    take: str | Sequence[str] | None

    def names(self, scan: Scan) -> tuple[str, ...]:
        """The components of the measurement.

        Raises:
            TrackbenchError: the sensor does not read one that is to be taken.
        """
        if isinstance(self.take, str):
            return COMMON_STATE[:2]
        read = SENSOR_MODELS[scan.kind].components
        for name in self.take or ():
            if name not in (*read, ELEVATION):
                raise TrackbenchError(f"the {scan.kind} {scan.sensor} reads no {name}: {nearest_choices(name, read)}")
        return read if self.take is None else tuple(self.take)

    def measurement(self, scan: Scan) -> Gaussian:
        """The measurement ``(m,)`` and the covariance ``(m, m)`` that the sensor states of it."""
        if isinstance(self.take, str):
            return SENSOR_MODELS[scan.kind].position(scan)
        if self.take is None:
            return Gaussian(scan.measurement, scan.noise_covariance)
        rows = self._rows(scan)
        # The row at the end is the elevation.
        measurement, noise = np.append(scan.measurement, 0.0), np.pad(scan.noise_covariance, (0, 1))
        return Gaussian(measurement[rows], noise[np.ix_(rows, rows)])

    def angular(self, scan: Scan) -> tuple[int, ...]:
        """Which components of the measurement are angles."""
        return tuple(i for i, name in enumerate(self.names(scan)) if name in ("azimuth", ELEVATION))

    def expected(self, x: Array, scan: Scan) -> Array:
        """``(m, ...)`` the measurement that a state ``(n, ...)`` should give."""
        target = self.layout.to_cartesian(x)
        if isinstance(self.take, str):
            return target[:2]
        ideal = SENSOR_MODELS[scan.kind].measure(target, scan.sensor_pose, scan.sensor_velocity)
        if self.take is None:
            return ideal
        return np.concatenate([ideal, np.zeros_like(ideal[:1])])[self._rows(scan)]

    def slope(self, x: Array, scan: Scan) -> Array:
        """``(m, n)`` derivative of ``expected`` at a state ``(n,)``."""
        to_cartesian = self.layout.cartesian_jacobian(x)
        if isinstance(self.take, str):
            return to_cartesian[:2]
        target = self.layout.to_cartesian(x)
        slope = SENSOR_MODELS[scan.kind].jacobian(target, scan.sensor_pose, scan.sensor_velocity)
        if self.take is not None:
            slope = np.pad(slope, ((0, 1), (0, 0)))[self._rows(scan)]
        return np.asarray(slope @ to_cartesian)

    def residual(self, a: Array, b: Array, scan: Scan) -> Array:
        """``(m, ...)`` the measurement ``a`` less ``b``, its angles wrapped."""
        return difference(a, b, self.angular(scan))

    def _rows(self, scan: Scan) -> list[int]:
        read = SENSOR_MODELS[scan.kind].components
        return [len(read) if name == ELEVATION else read.index(name) for name in self.names(scan)]
