"""A Kalman filter that gives out twice its covariance, for those who plan with it; inside it uses its own."""

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
    def __init__(self, margin=2.0):
        self.margin = margin

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return (scan.time, x, P), (x, self.margin * P)
        time, x, P = state
        F, Q = constant_velocity(scan.time - time)
        x, P = F @ x, F @ P @ F.T + Q
        if scan.valid:
            z, R = position(scan)
            K = np.linalg.solve(P[:2, :2] + R, P[:2]).T
            A = np.eye(4) - K @ np.eye(2, 4)
            x, P = x + K @ (z - x[:2]), A @ P @ A.T + K @ R @ K.T
        return (scan.time, x, P), (x, self.margin * P)
