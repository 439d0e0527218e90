"""The process noise follows the innovations: a smoothed NIS scales it between a quiet and an agile level."""

import numpy as np


def position(scan):
    """The position in the fixed frame and its covariance."""
    x, y, yaw = scan.sensor_pose
    radar = scan.kind == "radar"
    r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if radar else (1.0, yaw)
    c, s = np.cos(angle), np.sin(angle)
    J = np.array([[c, -r * s], [s, r * c]])
    local = np.array([r, 0.0]) if radar else scan.measurement
    return np.array([x, y]) + J @ local, J @ scan.noise_covariance[:2, :2] @ J.T


def constant_velocity(dt, sigma=3.0):
    F = np.eye(4) + dt * np.eye(4, k=2)
    G = sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    return F, G @ G.T


class Tracker:
    def __init__(self, quiet=2.5, agile=9.0, memory=0.8):
        self.quiet, self.agile, self.memory = quiet, agile, memory

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return (scan.time, x, P, 3.0), (x, P)
        time, x, P, sigma = state
        F, Q = constant_velocity(scan.time - time, sigma)
        x, P = F @ x, F @ P @ F.T + Q
        if scan.valid:
            z, R = position(scan)
            S, y = P[:2, :2] + R, z - x[:2]
            share = (y @ np.linalg.solve(S, y) / 2) ** 0.5
            wanted = np.clip(sigma * (0.5 + 0.5 * share), self.quiet, self.agile)
            sigma = self.memory * sigma + (1 - self.memory) * wanted
            K = np.linalg.solve(S, P[:2]).T
            A = np.eye(4) - K @ np.eye(2, 4)
            x, P = x + K @ y, A @ P @ A.T + K @ R @ K.T
        return (scan.time, x, P, sigma), (x, P)
