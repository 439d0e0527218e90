"""One scalar after the other: the noise is made uncorrelated, and each component is an update of its own."""

import numpy as np
from benchmarks.faults.parts import Filter, linear


class Tracker(Filter):
    def corrected(self, x, P, scan):
        z, H, R = linear(scan)
        variances, axes = np.linalg.eigh(R)
        for value, h, r in zip(axes.T @ z, axes.T @ H, variances, strict=True):
            Ph = P @ h
            k = Ph / (h @ Ph + r)
            x = x + k * (value - h @ x)
            P = P - np.outer(k, Ph)
        return x, (P + P.T) / 2
