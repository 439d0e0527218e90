"""What of a scan is given to a filter as its measurement, and what trackbench's own models expect there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.errors import TrackbenchError, nearest
from trackbench.base.types import COMMON_STATE, Array, Gaussian, Scan
from trackbench.base.units import difference
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.subjects.adaptors.layout import Layout

#: The measurement as the position that it states, in the fixed frame.
POSITION = "position"
#: A component that filters of three dimensions have; here every target is level with the sensor.
ELEVATION = "elevation"


def components() -> tuple[str, ...]:
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
                raise TrackbenchError(f"the {scan.kind} {scan.sensor} reads no {name}: {nearest(name, read)}")
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
