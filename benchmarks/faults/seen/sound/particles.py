"""A Gaussian particle filter."""

import numpy as np


def fixed_frame(scan, velocity=(0.0, 0.0)):
    """z, H and R: the position in the fixed frame, and of a radar the speed along the line of sight.

    An error of the azimuth turns the line of sight, along which a velocity near the predicted one is seen.
    """
    x, y, yaw = scan.sensor_pose
    if scan.kind == "lidar":
        T = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        return np.array([x, y]) + T @ scan.measurement, np.eye(2, 4), T @ scan.noise_covariance @ T.T
    r, c, s = scan.measurement[0], np.cos(yaw + scan.measurement[1]), np.sin(yaw + scan.measurement[1])
    across = s * (velocity[0] - scan.sensor_velocity[0]) - c * (velocity[1] - scan.sensor_velocity[1])
    J = np.array([[c, -r * s, 0.0], [s, r * c, 0.0], [0.0, across, 1.0]])
    H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, c, s]])
    rate = scan.measurement[2] + c * scan.sensor_velocity[0] + s * scan.sensor_velocity[1]
    return np.array([x + r * c, y + r * s, rate]), H, J @ scan.noise_covariance @ J.T


def first(scan):
    z, _, R = fixed_frame(scan)
    P = np.diag([0.0, 0.0, 400.0, 400.0])
    P[:2, :2] = R[:2, :2]
    return np.array([z[0], z[1], 0.0, 0.0]), P


def moved(x, P, dt, sigma=3.0):
    F = np.eye(4) + dt * np.eye(4, k=2)
    G = sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    return F @ x, F @ P @ F.T + G @ G.T


class Tracker:
    """Particles are drawn about the Kalman estimate and weighted by the exact likelihood over their own density."""

    random = True

    def __init__(self, particles=1000):
        self.n = particles
        self.generator = np.random.default_rng()

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
        else:
            time, x, P = state
            x, P = moved(x, P, scan.time - time)
            if scan.valid:
                x, P = self.weighted(x, P, scan)
        return (scan.time, x, P), (x, P)

    def weighted(self, x, P, scan):
        z, H, R = fixed_frame(scan, x[2:])
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
    y[:, 1] = (y[:, 1] + np.pi) % (2 * np.pi) - np.pi
    return y
