"""A regularised particle filter: the likelihood is let in by steps, and after each the particles are drawn anew.

What is drawn is spread by a kernel and drawn together as much, so that mean and covariance stay (Liu and West).
"""

import numpy as np
from benchmarks.faults.parts import first, push, transition, wrapped

SHRINK = 0.9


class Tracker:
    random = True

    def __init__(self, particles=2500, sigma=3.0):
        self.n, self.sigma = particles, sigma
        self.rng = np.random.default_rng()

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            X = x[:, None] + np.linalg.cholesky(P) @ self.rng.standard_normal((4, self.n))
        else:
            time, X = state
            dt = scan.time - time
            X = transition(dt) @ X
            if dt > 0:
                X = X + self.sigma * push(dt) @ self.rng.standard_normal((2, self.n))
            if scan.valid:
                X = self.weighed(X, scan)
        P = np.cov(X)
        return (scan.time, X), (X.mean(axis=1), (P + P.T) / 2)

    def weighed(self, X, scan):
        left = 1.0
        while left > 0:
            log = -residual(X, scan) / 2
            share = self.share(log - log.max(), left)
            w = np.exp(share * (log - log.max()))
            X = self.redrawn(X, w / w.sum())
            left = left - share if share < left else 0.0
        return X

    def share(self, log, left):
        """The largest exponent that leaves half of the particles effective."""

        def effective(a):
            w = np.exp(a * log)
            return w.sum() ** 2 / (w**2).sum() / self.n

        if effective(left) > 0.5:
            return left
        low, high = 0.0, left
        for _ in range(25):
            middle = (low + high) / 2
            low, high = (middle, high) if effective(middle) > 0.5 else (low, middle)
        return max(low, 1e-6 * left)

    def redrawn(self, X, w):
        mean = X @ w
        D = X - mean[:, None]
        C = (w * D) @ D.T
        places = (self.rng.random() + np.arange(self.n)) / self.n
        X = X[:, np.minimum(np.searchsorted(np.cumsum(w), places), self.n - 1)]
        kernel = np.linalg.cholesky((1 - SHRINK**2) * (C + 1e-12 * np.trace(C) * np.eye(4)))
        return SHRINK * X + (1 - SHRINK) * mean[:, None] + kernel @ self.rng.standard_normal((4, self.n))


def residual(X, scan):
    """Squared distance of the measurement from that of each particle, in units of the noise."""
    d, yaw = X[:2] - scan.sensor_pose[:2, None], scan.sensor_pose[2]
    if scan.kind == "lidar":
        y = scan.measurement[:, None] - np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]]) @ d
    else:
        r = np.maximum(np.hypot(*d), 1e-6)
        rate = (d * (X[2:] - scan.sensor_velocity[:, None])).sum(axis=0) / r
        y = scan.measurement[:, None] - np.array([r, np.arctan2(d[1], d[0]) - yaw, rate])
        y[1] = wrapped(y[1])
    return (y * np.linalg.solve(scan.noise_covariance, y)).sum(axis=0)
