"""An extended Kalman filter with constant velocity, plain NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np

from .plain import Array, Belief, PlainTracker, rotation, symmetric


class ConstantVelocity(PlainTracker):
    """State px, py, vx, vy with white acceleration that is constant over a step."""

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        F = self.transition_jacobian(dt)
        return self.transition(x, dt), symmetric(F @ P @ F.T) + self.process_noise(x, dt)

    def transition(self, x: Array, dt: float) -> Array:
        return np.array([x[0] + dt * x[2], x[1] + dt * x[3], x[2], x[3]])

    def transition_jacobian(self, dt: float) -> Array:
        return np.array([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1.0]])

    def process_noise(self, x: Array, dt: float) -> Array:
        G = np.array([[dt**2 / 2, 0], [0, dt**2 / 2], [dt, 0], [0, dt]])
        return self.acceleration_sigma**2 * G @ G.T


class PlainEkf(ConstantVelocity):
    """Radar (range, azimuth, range rate) and lidar (x, y) of one target."""

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        y = self.innovation(scan, self.predicted_measurement(x, scan))
        H = self.sensor_jacobian(x, scan)
        S = H @ P @ H.T + self.noise(scan)
        K = np.linalg.solve(S, H @ P).T
        return self.corrected(x, P, K, y, S)

    def sensor_jacobian(self, x: Array, scan: Any) -> Array:
        if scan.kind == "lidar":
            return np.hstack([rotation(scan.sensor_pose[2]).T, np.zeros((2, 2))])
        dx, dy = x[:2] - scan.sensor_pose[:2]
        vx, vy = x[2:] - scan.sensor_velocity
        r = self.range(dx, dy)
        across = (vx * dy - vy * dx) / r**3
        return np.array(
            [
                [dx / r, dy / r, 0, 0],
                [-dy / r**2, dx / r**2, 0, 0],
                [dy * across, -dx * across, dx / r, dy / r],
            ]
        )
