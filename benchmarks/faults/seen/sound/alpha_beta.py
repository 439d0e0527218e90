"""Constant gains (an alpha-beta filter), with the covariance of its own errors."""

import numpy as np
from benchmarks.faults.parts import first, moved, position, with_gain


class Tracker:
    def __init__(self, alpha=0.4, beta=0.1):
        self.alpha, self.beta = alpha, beta

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            return (scan.time, scan.time, x, P), (x, P)
        time, seen, x, P = state
        x, P = moved(x, P, scan.time - time)
        if scan.valid:
            z, R = position(scan)
            since = scan.time - seen
            K = np.vstack([self.alpha * np.eye(2), (self.beta / since if since > 0 else 0.0) * np.eye(2)])
            x, P = with_gain(x, P, K, z - x[:2], np.eye(2, 4), R)
            seen = scan.time
        return (scan.time, seen, x, P), (x, P)
