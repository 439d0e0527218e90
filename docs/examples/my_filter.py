"""A Kalman filter of constant velocity that knows nothing of sensors."""

import numpy as np


class MyFilter:
    def __init__(self, z, R):
        self.x, self.P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
        self.P[:2, :2] = R

    def predict(self, dt):
        F, G = np.eye(4) + dt * np.eye(4, k=2), 3.0 * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        self.x, self.P = F @ self.x, F @ self.P @ F.T + G @ G.T

    def update(self, z, R):
        H = np.eye(2, 4)
        K = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + R)
        A = np.eye(4) - K @ H
        self.x, self.P = self.x + K @ (z - H @ self.x), A @ self.P @ A.T + K @ R @ K.T
