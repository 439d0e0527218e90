"""An H-infinity filter: the bound theta on the worst error makes it trust its model less than a Kalman filter."""

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
    def __init__(self, theta=0.02):
        self.theta = theta

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return (scan.time, x, P), (x, P)
        time, x, P = state
        F, Q = constant_velocity(scan.time - time)
        x, P = F @ x, F @ P @ F.T + Q
        if scan.valid:
            z, R = position(scan)
            H, information = np.eye(2, 4), np.linalg.inv(P)
            weight = np.diag([1.0, 1.0, 0.1, 0.1])
            gained = information + H.T @ np.linalg.solve(R, H)
            theta = self.theta
            while np.linalg.eigvalsh(gained - theta * weight)[0] <= 0.2 * np.linalg.eigvalsh(gained)[0]:
                theta /= 2  # the bound cannot be met yet
            P = np.linalg.inv(gained - theta * weight)
            P = (P + P.T) / 2
            x = x + P @ H.T @ np.linalg.solve(R, z - x[:2])
        return (scan.time, x, P), (x, P)
