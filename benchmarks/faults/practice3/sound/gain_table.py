"""Gains from a table of eleven, by how much less accurate the prediction is than the measurement: no gain is computed.

Components are taken in one by one. The covariance is that of the gain that was taken, whatever it is.
"""

import numpy as np
from benchmarks.faults.parts import Filter, linear_at

# From which ratio of the variances, of the prediction to the measurement, which share of the innovation.
RATIOS = np.array([0.0, 0.004, 0.012, 0.035, 0.08, 0.17, 0.35, 0.75, 1.8, 6.0, 30.0])
SHARES = np.array([0.002, 0.008, 0.022, 0.05, 0.10, 0.20, 0.35, 0.55, 0.76, 0.93, 0.99])


def share(ratio):
    return SHARES[np.searchsorted(RATIOS, ratio, side="right") - 1]


class Tracker(Filter):
    def corrected(self, x, P, scan):
        z, H, R = linear_at(scan, x[2:])
        apart = np.linalg.inv(np.linalg.cholesky(R))  # components with independent errors of variance 1
        for value, row in zip(apart @ z, apart @ H, strict=True):
            x, P = self.taken_in(x, P, value, row)
        return x, P

    def taken_in(self, x, P, value, row):
        to_state = P @ row
        own = row @ to_state
        K = share(own) / own * to_state
        A = np.eye(4) - np.outer(K, row)
        P = A @ P @ A.T + np.outer(K, K)
        return x + K * (value - row @ x), (P + P.T) / 2
