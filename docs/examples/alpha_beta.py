"""An alpha-beta filter: fixed gains on the positions that lidar and radar read."""

import numpy as np


class AlphaBeta:
    def __init__(self, alpha=0.5, beta=0.1, acceleration_sigma=3.0):
        self.alpha, self.beta, self.sigma = alpha, beta, acceleration_sigma

    def step(self, state, scan):
        sx, sy, yaw = scan.sensor_pose
        r, a = scan.reading[:2] if scan.kind == "radar" else (1.0, 0.0)
        c, s = np.cos(yaw + a), np.sin(yaw + a)
        turn = np.array([[c, -r * s], [s, r * c]])  # carries errors of the reading into the fixed frame
        z = [sx, sy] + (turn @ [r, 0] if scan.kind == "radar" else turn @ scan.reading)
        R = turn @ scan.noise[:2, :2] @ turn.T
        if state is None:
            P = np.diag([0.0, 0.0, 20.0**2, 20.0**2])
            P[:2, :2] = R
            return (scan.time, scan.time, np.array([*z, 0, 0]), P), (np.array([*z, 0, 0]), P)
        time, updated, mean, P = state
        dt, since = scan.time - time, scan.time - updated
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        mean, P = F @ mean, F @ P @ F.T + self.sigma**2 * G @ G.T
        if scan.valid:
            K = np.vstack([self.alpha * np.eye(2), (self.beta / since if since else 0) * np.eye(2)])
            left = np.eye(4) - np.hstack([K, np.zeros((4, 2))])
            mean, P, updated = mean + K @ (z - mean[:2]), left @ P @ left.T + K @ R @ K.T, scan.time
        return (scan.time, updated, mean, P), (mean, P)
