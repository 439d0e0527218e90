"""Constant acceleration inside, six states with white jerk; position and velocity are given out."""

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


class Tracker:
    def __init__(self, jerk_density=8.0, acceleration_sigma=3.0):
        self.jerk, self.sigma = jerk_density, acceleration_sigma

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0, 0, 0, 0.0]), np.diag([0, 0, 400, 400, self.sigma**2, self.sigma**2]).astype(float)
            P[:2, :2] = R
            return (scan.time, x, P), (x[:4], P[:4, :4])
        time, x, P = state
        dt = scan.time - time
        F = np.kron([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]], np.eye(2))
        steps = [[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]]
        x, P = F @ x, F @ P @ F.T + self.jerk * np.kron(steps, np.eye(2))
        if scan.valid:
            z, R = position(scan)
            K = np.linalg.solve(P[:2, :2] + R, P[:2]).T
            A = np.eye(6) - K @ np.eye(2, 6)
            x, P = x + K @ (z - x[:2]), A @ P @ A.T + K @ R @ K.T
        return (scan.time, x, P), (x[:4], P[:4, :4])
