"""A gate leaves out what is far off; after three rejections in a row the velocity is freed and the gate is open."""

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
    def __init__(self, gate=20.0):
        self.gate = gate

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return (scan.time, x, P, 0), (x, P)
        time, x, P, rejected = state
        F, Q = constant_velocity(scan.time - time)
        x, P = F @ x, F @ P @ F.T + Q
        if scan.valid:
            z, R = position(scan)
            y, S = z - x[:2], P[:2, :2] + R
            if y @ np.linalg.solve(S, y) > self.gate:
                rejected += 1
                if rejected < 3:
                    return (scan.time, x, P, rejected), (x, P)
                P = P + np.diag([25.0, 25.0, 100.0, 100.0])
                S = P[:2, :2] + R
            K = np.linalg.solve(S, P[:2]).T
            A = np.eye(4) - K @ np.eye(2, 4)
            x, P, rejected = x + K @ y, A @ P @ A.T + K @ R @ K.T, 0
        return (scan.time, x, P, rejected), (x, P)
