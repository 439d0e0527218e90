"""Three levels of acceleration in an interacting-multiple-model filter; the mixing depends on the interval."""

import numpy as np
from benchmarks.faults.parts import first, linear, moved, updated

SIGMAS = (1.5, 4.0, 9.0)
LEAVE = np.array([[-0.6, 0.4, 0.2], [0.8, -1.2, 0.4], [0.6, 0.9, -1.5]])  # rates from row to column, 1/s


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            mu = np.array([0.3, 0.5, 0.2])
            return (scan.time, np.tile(x, (3, 1)), np.tile(P, (3, 1, 1)), mu), (x, P)
        time, X, C, mu = state
        dt = scan.time - time
        joint = np.linalg.inv(np.eye(3) - LEAVE * max(dt, 0.0)) * mu[:, None]
        mu = joint.sum(axis=0)
        weights = joint / mu
        before = X, C
        X, C = np.empty_like(X), np.empty_like(C)
        log = np.zeros(3)
        for j, sigma in enumerate(SIGMAS):
            X[j], C[j] = moved(*self.moments(*before, weights[:, j]), dt, sigma)
            if scan.valid:
                X[j], C[j], log[j] = self.corrected(X[j], C[j], *linear(scan))
        mu = mu * np.exp(log - log.max())
        mu = mu / mu.sum()
        return (scan.time, X, C, mu), self.moments(X, C, mu)

    def moments(self, X, C, weights):
        x = weights @ X
        d = X - x
        return x, np.einsum("i,ijk->jk", weights, C + np.einsum("ij,ik->ijk", d, d))

    def corrected(self, x, P, z, H, R):
        y, S = z - H @ x, H @ P @ H.T + R
        log = -0.5 * (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1])
        return *updated(x, P, z, H, R), log
