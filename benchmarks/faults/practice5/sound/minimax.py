"""A minimax (H infinity) filter: its gain bounds the worst ratio of the error to the noise, and is above Kalman's."""

import numpy as np
from benchmarks.faults.parts import Filter, linear_at


class Tracker(Filter):
    bound = 0.1  # 1 / gamma^2, of the error in standard deviations of the prediction

    def corrected(self, x, P, scan):
        z, H, R = linear_at(scan, x[2:])
        V = H.T @ np.linalg.inv(R)
        prior = np.linalg.inv(P)
        weight = self.bound * prior  # so that the bound has no unit
        worst = np.linalg.inv(prior - weight + V @ H)
        P = (worst + worst.T) / 2
        return x + P @ V @ (z - H @ x), P
