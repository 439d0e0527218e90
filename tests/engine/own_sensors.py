"""Sensors as users write them."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from trackbench.base import linalg
from trackbench.base.types import Array, Gaussian, Scan
from trackbench.models.sensors import Lidar, Sensor


class Sonar(Sensor):
    """Measures range and bearing."""

    range_sigma_m: float = 0.3
    bearing_sigma_deg: float = 1.0

    components: ClassVar[tuple[str, ...]] = ("range", "bearing")
    angular: ClassVar[tuple[int, ...]] = (1,)
    units: ClassVar[tuple[str, ...]] = ("m", "rad")
    sigma_options: ClassVar[tuple[str, ...]] = ("range_sigma_m", "bearing_sigma_deg")
    pure = True

    @classmethod
    def measure(cls, target: Array, pose: Array, velocity: Array) -> Array:
        dx, dy = target[0] - pose[0], target[1] - pose[1]
        bearing = np.arctan2(dy, dx) - pose[2]
        return linalg.vector([np.hypot(dx, dy), np.arctan2(np.sin(bearing), np.cos(bearing))])

    @classmethod
    def jacobian(cls, target: Array, pose: Array, velocity: Array) -> Array:
        dx, dy = target[0] - pose[0], target[1] - pose[1]
        r = np.hypot(dx, dy)
        return linalg.matrix([[dx / r, dy / r, 0, 0], [-dy / r**2, dx / r**2, 0, 0]])

    @classmethod
    def position(cls, scan: Scan) -> Gaussian:
        r, angle = scan.measurement[0], scan.measurement[1] + scan.sensor_pose[2]
        c, s = np.cos(angle), np.sin(angle)
        mean = linalg.vector([scan.sensor_pose[0] + r * c, scan.sensor_pose[1] + r * s])
        slope = linalg.matrix([[c, -r * s], [s, r * c]])
        return Gaussian(mean, linalg.quadratic(slope, scan.noise_covariance))


class Drifting(Lidar):
    """A lidar whose place drifts with time, as a Kalman filter converts it."""

    position_sigma_m: float = 0.15
    pure = True

    @classmethod
    def position(cls, scan: Scan) -> Gaussian:
        mean, covariance = super().position(scan)
        return Gaussian(mean + 0.05 * scan.time, covariance)


class Named(Lidar):
    """A lidar, one of which stands wrong."""

    position_sigma_m: float = 0.15
    pure = True

    @classmethod
    def position(cls, scan: Scan) -> Gaussian:
        mean, covariance = super().position(scan)
        return Gaussian(mean + 1.0 if scan.sensor == "lidar" else mean, covariance)
