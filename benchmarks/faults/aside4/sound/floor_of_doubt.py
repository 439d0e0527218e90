"""The measurement noise is trusted half, and no direction of the covariance may become smaller than a floor."""

import numpy as np
from benchmarks.faults.parts import Filter, linear_at, with_gain

UNITS = np.array([0.1, 0.1, 0.45, 0.45])  # m, m/s: the floor
HALF = 1.6


class Tracker(Filter):
    def corrected(self, x, P, scan):
        z, H, R = linear_at(scan, x[2:])
        R = HALF * R
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        x, P = with_gain(x, P, K, z - H @ x, H, R)
        return x, self.raised(P)

    def raised(self, P):
        values, vectors = np.linalg.eigh(P / np.outer(UNITS, UNITS))
        P = (vectors * np.maximum(values, 1.0)) @ vectors.T * np.outer(UNITS, UNITS)
        return (P + P.T) / 2
