"""A Gaussian particle filter."""

import numpy as np
from benchmarks.faults.parts import Filter, linear_at, wrapped


class Tracker(Filter):
    """Particles are drawn about the Kalman estimate and weighted by the exact likelihood over their own density."""

    random = True

    def __init__(self, particles=1000):
        self.n = particles
        self.generator = np.random.default_rng()

    def corrected(self, x, P, scan):
        z, H, R = linear_at(scan, x[2:])
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        m, C = x + K @ (z - H @ x), 1.5 * (P - K @ H @ P)
        C = (C + C.T) / 2 + 1e-10 * np.eye(4)
        X = self.generator.multivariate_normal(m, C, self.n)
        log = -0.5 * (squared(exact(X, scan), scan.noise_covariance) + squared(X - x, P) - squared(X - m, C))
        w = np.exp(log - log.max())
        w /= w.sum()
        mean = w @ X
        d = X - mean
        return mean, d.T @ (w[:, None] * d)


def squared(d, C):
    return np.einsum("ni,ij,nj->n", d, np.linalg.inv(C), d)


def exact(X, scan):
    """Differences of the measurement from that of each particle."""
    d, yaw = X[:, :2] - scan.sensor_pose[:2], scan.sensor_pose[2]
    c, s = np.cos(yaw), np.sin(yaw)
    local = d @ np.array([[c, -s], [s, c]])
    if scan.kind == "lidar":
        return scan.measurement - local
    r = np.maximum(np.hypot(d[:, 0], d[:, 1]), 1e-3)
    rate = (d * (X[:, 2:] - scan.sensor_velocity)).sum(axis=1) / r
    y = scan.measurement - np.column_stack([r, np.arctan2(local[:, 1], local[:, 0]), rate])
    y[:, 1] = wrapped(y[:, 1])
    return y
