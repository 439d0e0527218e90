"""Gains per kind of sensor, once learned from recordings; the covariance is carried only to be given out."""

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


GAINS = {"radar": (0.16, 0.35), "lidar": (0.45, 1.5)}  # of the position, and of the velocity in 1/s
FIRST = (0.9, 0.7, 0.5, 0.4, 0.35, 0.3)  # while the velocity is unknown
PUSH = (8.0, 6.0, 4.0, 3.0, 2.5, 2.0)


class Tracker:
    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return (scan.time, 0, x, P), (x, P)
        time, count, x, P = state
        F, Q = constant_velocity(scan.time - time, 2.5)
        x, P = F @ x, F @ P @ F.T + Q
        if scan.valid:
            z, R = position(scan)
            share, rate = GAINS.get(scan.kind, GAINS["radar"])
            if count < len(FIRST):
                share, rate = max(share, FIRST[count]), max(rate, PUSH[count])
            K = np.vstack([share * np.eye(2), rate * np.eye(2)])
            A = np.eye(4) - K @ np.eye(2, 4)
            x, P, count = x + K @ (z - x[:2]), A @ P @ A.T + K @ R @ K.T, count + 1
        return (scan.time, count, x, P), (x, P)
