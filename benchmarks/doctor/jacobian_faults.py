"""Wrong entries in the Jacobians of a plain EKF, whose predictions are right."""

from __future__ import annotations

from typing import Any

import numpy as np

from .plain import MIN_RANGE, Array


class RadarRow:
    """Changes the Jacobian of a radar in place, given the target's offset and velocity from the sensor."""

    def change(self, H: Array, offset: Array, velocity: Array) -> None:
        raise NotImplementedError

    def sensor_jacobian(self, x: Array, scan: Any) -> Array:
        H = super().sensor_jacobian(x, scan)
        if scan.kind == "radar":
            self.change(H, x[:2] - scan.sensor_pose[:2], x[2:] - scan.sensor_velocity)
        return H


class AzimuthSign(RadarRow):
    """The minus of -dy / r^2 forgotten."""

    def change(self, H: Array, offset: Array, velocity: Array) -> None:
        H[1, 0] *= -1


class AzimuthOverRange(RadarRow):
    """r where r^2 belongs."""

    def change(self, H: Array, offset: Array, velocity: Array) -> None:
        H[1] *= np.hypot(*offset)


class AzimuthRowInDegrees(RadarRow):
    """The azimuth's row in degrees per metre."""

    def change(self, H: Array, offset: Array, velocity: Array) -> None:
        H[1] *= 180 / np.pi


class AzimuthSwapped(RadarRow):
    """The two entries of the azimuth in each other's place."""

    def change(self, H: Array, offset: Array, velocity: Array) -> None:
        H[1, :2] = H[1, 1::-1].copy()


class RateWithoutPosition(RadarRow):
    """The range rate as if it did not depend on the position."""

    def change(self, H: Array, offset: Array, velocity: Array) -> None:
        H[2, :2] = 0


class RateTermMissing(RadarRow):
    """One of the two products left out of vx dy - vy dx."""

    def change(self, H: Array, offset: Array, velocity: Array) -> None:
        (dx, dy), vx = offset, velocity[0]
        H[2, :2] = vx * dy / np.maximum(np.hypot(dx, dy), MIN_RANGE) ** 3 * np.array([dy, -dx])


class RateVelocitySwapped(RadarRow):
    """dy / r for vx and dx / r for vy."""

    def change(self, H: Array, offset: Array, velocity: Array) -> None:
        H[2, 2:] = H[2, :1:-1].copy()


class LidarNotTurned:
    """The lidar's Jacobian without the sensor's yaw, which its prediction has."""

    def sensor_jacobian(self, x: Array, scan: Any) -> Array:
        return np.eye(2, 4) if scan.kind == "lidar" else super().sensor_jacobian(x, scan)


class TimeStepMissing:
    """The motion's Jacobian without dt."""

    def transition_jacobian(self, dt: float) -> Array:
        return np.eye(4)


class TimeStepMisplaced:
    """The motion's Jacobian with each dt beside the other axis' velocity."""

    def transition_jacobian(self, dt: float) -> Array:
        return np.array([[1, 0, 0, dt], [0, 1, dt, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
