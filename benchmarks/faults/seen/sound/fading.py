"""A fading memory filter: the predicted covariance is multiplied, and there is little process noise."""

import numpy as np
from benchmarks.faults.parts import Filter, linear_at, moved, with_gain


class Tracker(Filter):
    def __init__(self, memory=1.0, sigma=2.5):
        self.memory, self.sigma = memory, sigma  # s, m/s^2

    def predicted(self, x, P, dt):
        x, P = moved(x, P, dt, self.sigma)
        return x, np.exp(dt / self.memory) * P

    def corrected(self, x, P, scan):
        z, H, R = linear_at(scan, x[2:])
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        return with_gain(x, P, K, z - H @ x, H, R)
