"""An ensemble transform filter: 64 members, moved by a symmetric root instead of by perturbed measurements."""

import numpy as np
from benchmarks.faults.parts import first, linear_at, push, transition


class Tracker:
    random = True

    def __init__(self, members=64, inflation=1.003, sigma=3.0, seed=None):
        self.n, self.inflation, self.sigma = members, inflation, sigma
        self.generator = np.random.default_rng(seed)

    def drawn(self, dimensions):
        """Normal numbers, whose sample has exactly the mean 0 and the covariance 1."""
        E = self.generator.standard_normal((dimensions, self.n))
        E -= E.mean(axis=1, keepdims=True)
        return np.linalg.solve(np.linalg.cholesky(E @ E.T / (self.n - 1)), E)

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            X = x[:, None] + np.linalg.cholesky(P) @ self.drawn(4)
        else:
            time, X = state
            dt = scan.time - time
            X = transition(dt) @ X
            if dt > 0:
                X = X + self.sigma * push(dt) @ self.drawn(2)
            if scan.valid:
                X = self.transformed(X, scan)
        P = np.cov(X)
        return (scan.time, X), (X.mean(axis=1), (P + P.T) / 2)

    def transformed(self, X, scan):
        x = X.mean(axis=1)
        A = self.inflation * (X - x[:, None])
        z, H, R = linear_at(scan, x[2:])
        root = np.linalg.cholesky(R)
        S = np.linalg.solve(root, H @ A) / np.sqrt(self.n - 1)
        values, vectors = np.linalg.eigh(np.eye(self.n) + S.T @ S)
        w = (vectors / values) @ vectors.T @ S.T @ np.linalg.solve(root, z - H @ x) / np.sqrt(self.n - 1)
        T = (vectors / np.sqrt(values)) @ vectors.T
        return x[:, None] + A @ (w[:, None] + T)
