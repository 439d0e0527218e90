"""An M-estimator: the update is solved by reweighting, and a residual beyond 2 sigma counts less (Huber)."""

import numpy as np
from benchmarks.faults.parts import Filter, linear_at, with_gain


class Tracker(Filter):
    bend, rounds = 2.0, 3

    def corrected(self, x, P, scan):
        z, H, R = linear_at(scan, x[2:])
        root = np.linalg.cholesky(R)
        y = z - H @ x
        weights = np.ones(len(z))
        for _ in range(self.rounds):
            noise = root / weights @ root.T  # the columns of the root, by their weights
            K = np.linalg.solve(H @ P @ H.T + noise, H @ P).T
            residual = np.linalg.solve(root, y - H @ (K @ y))
            weights = np.minimum(1.0, self.bend / np.maximum(np.abs(residual), 1e-9))
        x, P = with_gain(x, P, K, y, H, noise)
        return x, (P + P.T) / 2
