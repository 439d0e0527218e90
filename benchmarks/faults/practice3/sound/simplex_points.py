"""An unscented filter with the n + 2 points of a spherical simplex in place of the usual 2 n + 1."""

import numpy as np
from benchmarks.faults.parts import Filter, wrapped


def simplex(n, central=0.25):
    """Directions (n, n + 2) and weights: a simplex about the centre, of unit covariance."""
    w = (1 - central) / (n + 1)
    Z = np.array([[0.0, -1 / np.sqrt(2 * w), 1 / np.sqrt(2 * w)]])
    for j in range(2, n + 1):
        a = 1 / np.sqrt(j * (j + 1) * w)
        last = np.concatenate([[0.0], np.full(j, -a), [j * a]])
        Z = np.vstack([np.column_stack([Z, np.zeros(j - 1)]), last])
    return Z, np.array([central] + [w] * (n + 1))


class Tracker(Filter):
    Z, W = simplex(4)

    def corrected(self, x, P, scan):
        X = x[:, None] + np.linalg.cholesky(P) @ self.Z
        M = self.sensed(X, scan)
        # Angles are averaged as offsets from the first point, which is the central one.
        D = M - M[:, :1]
        if scan.kind == "radar":
            D[1] = wrapped(D[1])
        mean = D @ self.W
        y = scan.measurement - M[:, 0] - mean
        if scan.kind == "radar":
            y[1] = wrapped(y[1])
        D = D - mean[:, None]
        S = (self.W * D) @ D.T + scan.noise_covariance
        C = (self.W * (X - x[:, None])) @ D.T
        K = np.linalg.solve(S, C.T).T
        P = P - K @ S @ K.T
        return x + K @ y, (P + P.T) / 2

    def sensed(self, X, scan):
        d = X[:2] - scan.sensor_pose[:2, None]
        yaw = scan.sensor_pose[2]
        if scan.kind == "lidar":
            return np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]]) @ d
        r = np.hypot(*d)
        rate = (d * (X[2:] - scan.sensor_velocity[:, None])).sum(axis=0) / r
        return np.array([r, wrapped(np.arctan2(d[1], d[0]) - yaw), rate])
