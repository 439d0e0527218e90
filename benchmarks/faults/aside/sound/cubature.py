"""A cubature Kalman filter: eight points of equal weight, drawn before the prediction and again before the update."""

import numpy as np
from benchmarks.faults.parts import Filter, constant_velocity, difference, expected


def points(x, P):
    root = 2.0 * np.linalg.cholesky(P)  # the root of n = 4
    return x[:, None] + np.hstack([root, -root])


class Tracker(Filter):
    def predicted(self, x, P, dt):
        F, Q = constant_velocity(dt)
        X = F @ points(x, P)
        x = X.mean(axis=1)
        return x, (X - x[:, None]) @ (X - x[:, None]).T / 8 + Q

    def corrected(self, x, P, scan):
        X = points(x, P)
        centre = expected(x, scan)[0]
        offsets = np.array([difference(expected(column, scan)[0], centre, scan) for column in X.T]).T
        mean = offsets.mean(axis=1)
        dz, dx = offsets - mean[:, None], X - x[:, None]
        S = dz @ dz.T / 8 + scan.noise_covariance
        K = np.linalg.solve(S, dz @ dx.T / 8).T
        P = P - K @ S @ K.T
        return x + K @ (difference(scan.measurement, centre, scan) - mean), (P + P.T) / 2
