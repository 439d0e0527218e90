"""A Schmidt-Kalman filter: a bias of the lidar is considered in the gain and never estimated."""

import numpy as np
from benchmarks.faults.parts import first, linear_at, moved, transition


class Tracker:
    def __init__(self, bias_sigma=0.1):
        self.B = bias_sigma**2 * np.eye(2)

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            C = np.zeros((4, 2))  # covariance with the bias, in the fixed frame
            if scan.kind == "lidar":
                P[:2, :2] += self.B
                C[:2] = -self.B
        else:
            time, x, P, C = state
            dt = scan.time - time
            x, P = moved(x, P, dt)
            C = transition(dt) @ C
            if scan.valid:
                x, P, C = self.update(x, P, C, scan)
        return (scan.time, x, P, C), (x, P)

    def update(self, x, P, C, scan):
        z, H, R = linear_at(scan, x[2:])
        J = np.eye(2) if scan.kind == "lidar" else np.zeros((len(z), 2))  # z = H x + J bias + noise
        S = H @ P @ H.T + H @ C @ J.T + J @ C.T @ H.T + J @ self.B @ J.T + R
        K = (P @ H.T + C @ J.T) @ np.linalg.inv(S)
        A = np.eye(4) - K @ H
        P = A @ P @ A.T - A @ C @ J.T @ K.T - K @ J @ C.T @ A.T + K @ (J @ self.B @ J.T + R) @ K.T
        return x + K @ (z - H @ x), (P + P.T) / 2, A @ C - K @ J @ self.B
