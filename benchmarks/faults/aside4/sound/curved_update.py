"""A second-order extended filter: curvature of the measurement shifts its mean and widens its covariance."""

import numpy as np
from benchmarks.faults.parts import Filter, difference, expected

STEP = np.array([0.05, 0.05, 0.05, 0.05])


def hessians(x, scan, H):
    """(m, 4, 4), as differences of the first derivative, made symmetric."""
    M = np.zeros((len(H), 4, 4))
    for k, size in enumerate(STEP):
        d = size * np.eye(4)[k]
        M[:, :, k] = (expected(x + d, scan)[1] - expected(x - d, scan)[1]) / (2 * size)
    return (M + M.transpose(0, 2, 1)) / 2


class Tracker(Filter):
    def corrected(self, x, P, scan):
        h, H = expected(x, scan)
        B = hessians(x, scan, H) @ P
        shift = np.trace(B, axis1=1, axis2=2) / 2
        extra = np.einsum("aij,bji->ab", B, B) / 2
        S = H @ P @ H.T + extra + scan.noise_covariance
        K = np.linalg.solve(S, H @ P).T
        P = P - K @ S @ K.T
        x = x + K @ (difference(scan.measurement, h, scan) - shift)
        return x, (P + P.T) / 2
