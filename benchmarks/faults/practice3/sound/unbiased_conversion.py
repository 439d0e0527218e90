"""Polar measurements, converted without bias (Mo Longbin), and after them the range rate about the corrected state."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Belief:
    time: float
    mean: np.ndarray
    covariance: np.ndarray

    def at(self, time: float, sigma: float) -> Belief:
        dt = time - self.time
        F = np.block([[np.eye(2), dt * np.eye(2)], [np.zeros((2, 2)), np.eye(2)]])
        Q = sigma**2 * np.kron([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]], np.eye(2))
        return Belief(time, F @ self.mean, F @ self.covariance @ F.T + Q)

    def given(self, innovation: np.ndarray, H: np.ndarray, R: np.ndarray) -> Belief:
        P = self.covariance
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        A = np.eye(4) - K @ H
        P = A @ P @ A.T + K @ R @ K.T
        return replace(self, mean=self.mean + K @ innovation, covariance=(P + P.T) / 2)


@dataclass(frozen=True)
class Tracker:
    acceleration_sigma: float = 3.0
    velocity_sigma: float = 20.0

    def step(self, belief: Belief | None, scan):
        if belief is None:
            z, R = place(scan)
            P = np.diag([0.0, 0.0, self.velocity_sigma**2, self.velocity_sigma**2])
            P[:2, :2] = R
            belief = Belief(scan.time, np.array([*z, 0.0, 0.0]), P)
        else:
            belief = belief.at(scan.time, self.acceleration_sigma)
            if scan.valid:
                belief = self.corrected(belief, scan)
        return belief, (belief.mean, belief.covariance)

    def corrected(self, belief: Belief, scan) -> Belief:
        z, R = place(scan)
        belief = belief.given(z - belief.mean[:2], np.eye(2, 4), R)
        if scan.kind != "radar":
            return belief
        d, u = belief.mean[:2] - scan.sensor_pose[:2], belief.mean[2:] - scan.sensor_velocity
        r = np.hypot(*d)
        rate = d @ u / r
        H = np.array([[*(u - rate * d / r) / r, *d / r]])
        return belief.given(scan.measurement[2:] - rate, H, scan.noise_covariance[2:, 2:])


def place(scan) -> tuple[np.ndarray, np.ndarray]:
    """Position in the fixed frame and its covariance."""
    x, y, yaw = scan.sensor_pose
    if scan.kind != "radar":
        T = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        return np.array([x, y]) + T @ scan.measurement, T @ scan.noise_covariance @ T.T
    r, b = scan.measurement[0], yaw + scan.measurement[1]
    range_variance, variance = scan.noise_covariance[0, 0], scan.noise_covariance[1, 1]
    shrink = np.exp(-variance / 2)  # the mean of the cosine of the error
    spread = shrink**-2 - 2
    whole = (r**2 + range_variance) / 2
    c, s = np.cos(b), np.sin(b)
    double, twice = shrink**4 * np.cos(2 * b), shrink**4 * np.sin(2 * b)
    xx = spread * r**2 * c**2 + whole * (1 + double)
    yy = spread * r**2 * s**2 + whole * (1 - double)
    xy = spread * r**2 * c * s + whole * twice
    return np.array([x + r * c / shrink, y + r * s / shrink]), np.array([[xx, xy], [xy, yy]])
