"""An ensemble Kalman filter with perturbed observations."""

import numpy as np
from benchmarks.faults.parts import first, linear_at


class Tracker:
    random = True

    def __init__(self, members=400):
        self.members = members
        self.generator = np.random.default_rng()

    def step(self, state, scan):
        n, rng = self.members, self.generator
        if state is None:
            x, P = first(scan)
            X = rng.multivariate_normal(x, P, n)
        else:
            time, X = state
            dt = scan.time - time
            a = rng.normal(0.0, 3.0, (n, 2))
            X = np.hstack([X[:, :2] + dt * X[:, 2:] + dt**2 / 2 * a, X[:, 2:] + dt * a])
            if scan.valid:
                z, H, R = linear_at(scan, X[:, 2:].mean(axis=0))
                P = np.cov(X.T)
                K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
                X = X + (z + rng.multivariate_normal(np.zeros(len(z)), R, n) - X @ H.T) @ K.T
        return (scan.time, X), (X.mean(axis=0), np.cov(X.T) + 1e-9 * np.eye(4))
