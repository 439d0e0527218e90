"""A Gaussian particle filter: draws from near the measurement, weights, and again a Gaussian. The draws are fixed."""

import numpy as np
from benchmarks.faults.parts import Filter, linear_at, with_gain, wrapped


def lattice(count, dimensions):
    """Draws of a normal distribution with exact mean and covariance."""
    draws = np.random.default_rng(3).standard_normal((count, dimensions))
    draws = np.vstack([draws, -draws])
    return draws @ np.linalg.inv(np.linalg.cholesky(draws.T @ draws / len(draws))).T


DRAWS = lattice(1500, 4)
SPREAD = 1.3


def gaps(points, scan):
    """Of what the sensor would measure of each point from what it has measured."""
    d, u = points[:, :2] - scan.sensor_pose[:2], points[:, 2:] - scan.sensor_velocity
    yaw = scan.sensor_pose[2]
    if scan.kind != "radar":
        c, s = np.cos(yaw), np.sin(yaw)
        return scan.measurement - d @ np.array([[c, -s], [s, c]])
    r = np.hypot(*d.T)
    azimuth = np.arctan2(d[:, 1], d[:, 0]) - yaw
    z = scan.measurement
    return np.column_stack([z[0] - r, wrapped(z[1] - azimuth), z[2] - np.sum(d * u, axis=1) / r])


class Tracker(Filter):
    def corrected(self, x, P, scan):
        z, H, R = linear_at(scan, x[2:])
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        m, C = with_gain(x, P, K, z - H @ x, H, R)
        L = SPREAD * np.linalg.cholesky((C + C.T) / 2 + 1e-12 * np.eye(4))
        points = m + DRAWS @ L.T
        # Prior and likelihood of each point, over the density that it is drawn from.
        off, miss = points - x, gaps(points, scan)
        log = 0.5 * np.sum(DRAWS**2, axis=1)
        log -= 0.5 * np.sum(off * np.linalg.solve(P, off.T).T, axis=1)
        log -= 0.5 * np.sum(miss * np.linalg.solve(scan.noise_covariance, miss.T).T, axis=1)
        w = np.exp(log - log.max())
        w /= w.sum()
        x = w @ points
        off = points - x
        P = (off * w[:, None]).T @ off
        return x, (P + P.T) / 2
