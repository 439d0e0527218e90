"""A filter with Student's t distributions of state and noise: the covariance depends on the innovation."""

import numpy as np
from benchmarks.faults.parts import Filter, linear_at


class Tracker(Filter):
    def __init__(self, degrees=12.0):
        self.nu = degrees

    def corrected(self, x, P, scan):
        z, H, R = linear_at(scan, x[2:])
        S = H @ P @ H.T + R
        K = P @ H.T @ np.linalg.inv(S)
        y = z - H @ x
        d2 = y @ np.linalg.solve(S, y)
        P = (self.nu + d2) / (self.nu + len(z)) * (P - K @ S @ K.T)
        return x + K @ y, (P + P.T) / 2
