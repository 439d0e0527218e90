"""All memory is in the instance; the state is only the number of scans."""

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
    def __init__(self):
        self.x = self.P = self.time = None

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            self.x, self.P = x, P
        else:
            F, Q = constant_velocity(scan.time - self.time)
            self.x, self.P = F @ self.x, F @ self.P @ F.T + Q
            if scan.valid:
                z, R = position(scan)
                K = np.linalg.solve(self.P[:2, :2] + R, self.P[:2]).T
                A = np.eye(4) - K @ np.eye(2, 4)
                self.x = self.x + K @ (z - self.x[:2])
                self.P = A @ self.P @ A.T + K @ R @ K.T
        self.time = scan.time
        return (state or 0) + 1, (self.x.copy(), self.P.copy())
