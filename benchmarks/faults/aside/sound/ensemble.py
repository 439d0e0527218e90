"""An ensemble Kalman filter with perturbed measurements; its random numbers are a function of the step's number."""

import numpy as np
from benchmarks.faults.parts import first, position, transition


class Tracker:
    def __init__(self, members=200, acceleration_sigma=3.0):
        self.members, self.sigma = members, acceleration_sigma

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            draw = np.random.default_rng(0).standard_normal((4, self.members))
            X = x[:, None] + np.linalg.cholesky(P) @ self.centred(draw)
            return (scan.time, 1, X), self.moments(X)
        time, count, X = state
        rng = np.random.default_rng(count)
        dt = scan.time - time
        push = self.sigma * self.centred(rng.standard_normal((2, self.members)))
        X = transition(dt) @ X + np.vstack([dt**2 / 2 * push, dt * push])
        if scan.valid:
            z, R = position(scan)
            _, P = self.moments(X)
            noise = np.linalg.cholesky(R) @ self.centred(rng.standard_normal((2, self.members)))
            K = P[:, :2] @ np.linalg.inv(P[:2, :2] + R)
            X = X + K @ (z[:, None] + noise - X[:2])
        return (scan.time, count + 1, X), self.moments(X)

    def centred(self, draw):
        return draw - draw.mean(axis=1, keepdims=True)

    def moments(self, X):
        return X.mean(axis=1), np.cov(X) + 1e-9 * np.eye(4)
