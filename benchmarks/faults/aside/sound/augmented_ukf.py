"""An unscented filter whose points carry the acceleration too: no noise is added, and the moved points are updated."""

import numpy as np
from benchmarks.faults.parts import difference, expected, first


class Tracker:
    """alpha .5, beta 2, kappa 0 over four states and two accelerations."""

    def __init__(self, acceleration_sigma=3.0):
        self.sigma = acceleration_sigma
        n, alpha, beta = 6, 0.5, 2.0
        spread = alpha**2 * n
        self.spread = spread
        self.mean_weights = np.full(2 * n + 1, 0.5 / spread)
        self.mean_weights[0] = 1 - n / spread
        self.weights = self.mean_weights.copy()
        self.weights[0] += 1 - alpha**2 + beta

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            return (scan.time, x, P), (x, P)
        time, x, P = state
        dt = scan.time - time
        augmented = np.zeros((6, 6))
        augmented[:4, :4], augmented[4:, 4:] = P, self.sigma**2 * np.eye(2)
        root = np.linalg.cholesky(self.spread * augmented)
        centre = np.concatenate([x, np.zeros(2)])[:, None]
        X = np.hstack([centre, centre + root, centre - root])
        moved = np.vstack([X[:2] + dt * X[2:4] + dt**2 / 2 * X[4:], X[2:4] + dt * X[4:]])
        x = moved @ self.mean_weights
        dx = moved - x[:, None]
        P = (self.weights * dx) @ dx.T
        if scan.valid:
            base = expected(x, scan)[0]
            offsets = np.array([difference(expected(column, scan)[0], base, scan) for column in moved.T]).T
            mean = offsets @ self.mean_weights
            dz = offsets - mean[:, None]
            S = (self.weights * dz) @ dz.T + scan.noise_covariance
            K = np.linalg.solve(S, (self.weights * dz) @ dx.T).T
            x, P = x + K @ (difference(scan.measurement, base, scan) - mean), P - K @ S @ K.T
        P = (P + P.T) / 2 + 1e-9 * np.eye(4)
        return (scan.time, x, P), (x, P)
