"""Lidar, which measures position in the sensor's frame."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base import linalg
from trackbench.base.types import Array, Gaussian, Scan
from trackbench.models.sensors.base import Sensor


class Lidar(Sensor):
    """Lidar that measures the position in its own frame: x forward, y to the left, m."""

    position_sigma_m: float = Field(
        ge=1e-6, le=1e4, description="Standard deviation of the position along each axis of the sensor's frame, m."
    )

    components: ClassVar[tuple[str, ...]] = ("x", "y")
    units: ClassVar[tuple[str, ...]] = ("m", "m")
    sigma_options: ClassVar[tuple[str, ...]] = ("position_sigma_m", "position_sigma_m")

    def uniform(self, shares: Array) -> Array:
        """Return measurements uniformly distributed in x and y over the sector in the field of view."""
        assert self.max_range_m is not None
        reach, azimuth = self.max_range_m * np.sqrt(shares[0]), (shares[1] - 0.5) * np.deg2rad(self.fov_deg)
        return np.stack([reach * np.cos(azimuth), reach * np.sin(azimuth)])

    def volume(self) -> float:
        """Return the area of the sector in the field of view, m^2."""
        assert self.max_range_m is not None
        return float(0.5 * np.deg2rad(self.fov_deg) * self.max_range_m**2)

    @classmethod
    def measure(cls, target: Array, pose: Array, velocity: Array) -> Array:
        dx, dy = target[0] - pose[0], target[1] - pose[1]
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return linalg.vector([c * dx + s * dy, c * dy - s * dx])

    @classmethod
    def jacobian(cls, target: Array, pose: Array, velocity: Array) -> Array:
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return linalg.matrix([[c, s, 0, 0], [-s, c, 0, 0]])

    @classmethod
    def position(cls, scan: Scan) -> Gaussian:
        sx, sy, yaw = scan.sensor_pose
        c, s = np.cos(yaw), np.sin(yaw)
        x, y = scan.measurement
        rotation = linalg.matrix([[c, -s], [s, c]])
        covariance = linalg.rounded_up(linalg.quadratic(rotation, scan.noise_covariance))
        return Gaussian(linalg.vector([sx + c * x - s * y, sy + s * x + c * y]), covariance)
