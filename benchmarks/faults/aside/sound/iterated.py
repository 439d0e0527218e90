"""An iterated extended Kalman filter: each measurement is linearised again at the corrected state, up to five times."""

import numpy as np
from benchmarks.faults.parts import Filter, difference, expected


class Tracker(Filter):
    def corrected(self, x, P, scan):
        prior, R = x, scan.noise_covariance
        for _ in range(5):
            prediction, H = expected(x, scan)
            K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
            step = prior + K @ (difference(scan.measurement, prediction, scan) - H @ (prior - x)) - x
            x = x + step
            if np.abs(step).max() < 1e-9:
                break
        A = np.eye(4) - K @ H
        return x, A @ P @ A.T + K @ R @ K.T
