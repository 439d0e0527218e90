"""Lidar: position in the sensor's frame."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from trackbench import linalg
from trackbench.types import Array, Gaussian, Scan


class Lidar:
    """Position x (forward), y (left) of the target in the sensor's frame, m."""

    kind: ClassVar[str] = "lidar"
    components: ClassVar[tuple[str, ...]] = ("x", "y")
    angular: ClassVar[tuple[int, ...]] = ()

    def measure(self, target: Array, pose: Array, velocity: Array) -> Array:
        dx, dy = target[0] - pose[0], target[1] - pose[1]
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return linalg.vector([c * dx + s * dy, c * dy - s * dx])

    def jacobian(self, target: Array, pose: Array, velocity: Array) -> Array:
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return linalg.matrix([[c, s, 0, 0], [-s, c, 0, 0]])

    def position(self, scan: Scan) -> Gaussian:
        sx, sy, yaw = scan.sensor_pose
        c, s = np.cos(yaw), np.sin(yaw)
        x, y = scan.measurement
        rotation = linalg.matrix([[c, -s], [s, c]])
        return Gaussian(
            linalg.vector([sx + c * x - s * y, sy + s * x + c * y]), linalg.quadratic(rotation, scan.noise_covariance)
        )

    def radial_velocity(self, scan: Scan) -> Array:
        return np.zeros((2, *scan.measurement.shape[1:]))
