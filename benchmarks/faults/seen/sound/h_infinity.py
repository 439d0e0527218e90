"""An H-infinity filter: the gain bounds the worst case, and its matrix is larger than a covariance."""

import numpy as np
from benchmarks.faults.parts import Filter, linear_at


class Tracker(Filter):
    def __init__(self, theta=0.3):
        self.theta = theta  # 1 / m^2, on the position

    def corrected(self, x, P, scan):
        z, H, R = linear_at(scan, x[2:])
        bound = self.theta * np.diag([1.0, 1.0, 0.0, 0.0])
        inverse = np.linalg.inv(P) + H.T @ np.linalg.inv(R) @ H
        limited = inverse - bound
        P = np.linalg.inv(limited if np.linalg.eigvalsh(limited)[0] > 1e-4 else inverse)
        return x + P @ H.T @ np.linalg.solve(R, z - H @ x), (P + P.T) / 2
