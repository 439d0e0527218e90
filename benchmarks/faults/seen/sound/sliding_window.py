"""Least squares over the latest positions: no filter, no gain."""

import numpy as np


def fixed_frame(scan, velocity=(0.0, 0.0)):
    """z, H and R: the position in the fixed frame, and of a radar the speed along the line of sight.

    An error of the azimuth turns the line of sight, along which a velocity near the predicted one is seen.
    """
    x, y, yaw = scan.sensor_pose
    if scan.kind == "lidar":
        T = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        return np.array([x, y]) + T @ scan.measurement, np.eye(2, 4), T @ scan.noise_covariance @ T.T
    r, c, s = scan.measurement[0], np.cos(yaw + scan.measurement[1]), np.sin(yaw + scan.measurement[1])
    across = s * (velocity[0] - scan.sensor_velocity[0]) - c * (velocity[1] - scan.sensor_velocity[1])
    J = np.array([[c, -r * s, 0.0], [s, r * c, 0.0], [0.0, across, 1.0]])
    H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, c, s]])
    rate = scan.measurement[2] + c * scan.sensor_velocity[0] + s * scan.sensor_velocity[1]
    return np.array([x + r * c, y + r * s, rate]), H, J @ scan.noise_covariance @ J.T


def first(scan):
    z, _, R = fixed_frame(scan)
    P = np.diag([0.0, 0.0, 400.0, 400.0])
    P[:2, :2] = R[:2, :2]
    return np.array([z[0], z[1], 0.0, 0.0]), P


def moved(x, P, dt, sigma=3.0):
    F = np.eye(4) + dt * np.eye(4, k=2)
    G = sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    return F @ x, F @ P @ F.T + G @ G.T


class Tracker:
    def __init__(self, window=15, sigma=2.0):
        self.window, self.sigma = window, sigma

    def step(self, state, scan):
        kept = [] if state is None else state
        if scan.valid:
            z, _, R = fixed_frame(scan)
            kept = [*kept, (scan.time, z[:2], R[:2, :2])][-self.window :]
        return kept, self.fit(kept, scan.time)

    def fit(self, kept, now):
        Y = np.diag([1e-9, 1e-9, 1 / 400.0, 1 / 400.0])
        y = np.zeros(4)
        for time, z, R in kept:
            age = now - time
            A = np.hstack([np.eye(2), -age * np.eye(2)])
            W = np.linalg.inv(R + (self.sigma * age**2 / 2) ** 2 * np.eye(2))
            Y += A.T @ W @ A
            y += A.T @ W @ z
        age = now - kept[-1][0]
        P = np.linalg.inv(Y)
        G = 3.0 * np.vstack([age**2 / 2 * np.eye(2), age * np.eye(2)])
        return P @ y, (P + P.T) / 2 + G @ G.T + np.diag([0.0, 0.0, 0.5, 0.5])
