"""An ensemble Kalman filter with perturbed measurements; its random numbers are a function of the step's number."""

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
    def __init__(self, members=200, acceleration_sigma=3.0):
        self.members, self.sigma = members, acceleration_sigma

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            draw = np.random.default_rng(0).standard_normal((4, self.members))
            X = x[:, None] + np.linalg.cholesky(P) @ self.centred(draw)
            return (scan.time, 1, X), self.moments(X)
        time, count, X = state
        rng = np.random.default_rng(count)
        dt = scan.time - time
        F, _ = constant_velocity(dt)
        push = self.sigma * self.centred(rng.standard_normal((2, self.members)))
        X = F @ X + np.vstack([dt**2 / 2 * push, dt * push])
        if scan.valid:
            z, R = position(scan)
            _, P = self.moments(X)
            noise = np.linalg.cholesky(R) @ self.centred(rng.standard_normal((2, self.members)))
            K = P[:, :2] @ np.linalg.inv(P[:2, :2] + R)
            X = X + K @ (z[:, None] + noise - X[:2])
        return (scan.time, count + 1, X), self.moments(X)

    def centred(self, draw):
        return draw - draw.mean(axis=1, keepdims=True)

    def moments(self, X):
        return X.mean(axis=1), np.cov(X) + 1e-9 * np.eye(4)
