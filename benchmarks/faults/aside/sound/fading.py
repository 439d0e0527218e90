"""A fading-memory filter: besides a small process noise, the predicted covariance grows by a factor of the interval."""

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


def linear(scan):
    """z, H and R in the fixed frame: the position, and of a radar the speed over ground along the ray."""
    radar, yaw = scan.kind == "radar", scan.sensor_pose[2]
    r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if radar else (1.0, yaw)
    c, s = np.cos(angle), np.sin(angle)
    J = np.array([[c, -r * s], [s, r * c]])
    z = scan.sensor_pose[:2] + J @ (np.array([r, 0.0]) if radar else scan.measurement)
    H, R = np.eye(2, 4), J @ scan.noise_covariance[:2, :2] @ J.T
    if radar:
        z = np.append(z, scan.measurement[2] + np.array([c, s]) @ scan.sensor_velocity)
        H = np.vstack([H, [0.0, 0.0, c, s]])
        R = np.pad(R, (0, 1))
        R[2, 2] = scan.noise_covariance[2, 2] + 0.15**2  # the ray is that of the measured azimuth
    return z, H, R


def constant_velocity(dt, sigma=3.0):
    F = np.eye(4) + dt * np.eye(4, k=2)
    G = sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    return F, G @ G.T


class Tracker:
    """`forget` is the time constant in which old measurements lose their weight, s."""

    def __init__(self, forget=2.0):
        self.forget = forget

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return (scan.time, x, P), (x, P)
        time, x, P = state
        dt = scan.time - time
        F, Q = constant_velocity(dt, 3.0)
        x, P = F @ x, np.exp(dt / self.forget) * F @ P @ F.T + Q
        if scan.valid:
            z, H, R = linear(scan)
            K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
            A = np.eye(4) - K @ H
            x, P = x + K @ (z - H @ x), A @ P @ A.T + K @ R @ K.T
        return (scan.time, x, P), (x, P)
