"""A critically damped alpha-beta filter: gains of the interval alone. Its covariance is that of its own errors."""

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
    """Discount theta per second; a first estimate of the velocity needs two measurements."""

    def __init__(self, theta=1e-4, acceleration_sigma=4.0):
        self.theta, self.sigma = theta, acceleration_sigma

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return (scan.time, scan.time, 1, x, P), (x, P)
        time, updated, count, x, P = state
        F, Q = constant_velocity(scan.time - time, self.sigma)
        x, P = F @ x, F @ P @ F.T + Q
        if scan.valid:
            z, R = position(scan)
            since = max(scan.time - updated, 0.0)
            keep = self.theta ** (since / 2) if since > 0 else 1.0
            alpha, beta = 1 - keep**2, (1 - keep) ** 2
            count += 1
            grown = 2 * (2 * count - 1) / (count * (count + 1))  # of the expanding memory, until it is smaller
            alpha = max(alpha, grown) if count < 8 else max(alpha, 0.05)
            beta = max(beta, 6 / (count * (count + 1))) if count < 8 else beta
            K = np.vstack([alpha * np.eye(2), (beta / since if since > 0 else 0.0) * np.eye(2)])
            A = np.eye(4) - np.hstack([K, np.zeros((4, 2))])
            x, P = x + K @ (z - x[:2]), A @ P @ A.T + K @ R @ K.T
            updated = scan.time
        return (scan.time, updated, count, x, P), (x, P)
