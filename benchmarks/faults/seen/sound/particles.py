"""A particle filter, resampled and regularised where few particles have the weight."""

import numpy as np


def fixed_frame(scan):
    """z, H and R: the position in the fixed frame, and of a radar the speed along the line of sight."""
    x, y, yaw = scan.sensor_pose
    if scan.kind == "lidar":
        T = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        return np.array([x, y]) + T @ scan.measurement, np.eye(2, 4), T @ scan.noise_covariance @ T.T
    r, c, s = scan.measurement[0], np.cos(yaw + scan.measurement[1]), np.sin(yaw + scan.measurement[1])
    J = np.array([[c, -r * s, 0.0], [s, r * c, 0.0], [0.0, 0.0, 1.0]])
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
    random = True

    def __init__(self, particles=3000):
        self.n = particles
        self.generator = np.random.default_rng()

    def step(self, state, scan):
        n, rng = self.n, self.generator
        if state is None:
            x, P = first(scan)
            X, w = rng.multivariate_normal(x, P, n), np.full(n, 1 / n)
        else:
            time, X, w = state
            dt = scan.time - time
            a = rng.normal(0.0, 3.0, (n, 2))
            X = np.hstack([X[:, :2] + dt * X[:, 2:] + dt**2 / 2 * a, X[:, 2:] + dt * a])
            if scan.valid:
                X, w = self.weighted(X, w, scan)
        mean = w @ X
        d = X - mean
        return (scan.time, X, w), (mean, d.T @ (w[:, None] * d) + 1e-6 * np.eye(4))

    def weighted(self, X, w, scan):
        z, H, R = fixed_frame(scan)
        y = z - X @ H.T
        log = np.log(w + 1e-300) - 0.5 * np.einsum("ni,ij,nj->n", y, np.linalg.inv(R), y)
        w = np.exp(log - log.max())
        w /= w.sum()
        if 1 / (w @ w) > self.n / 2:
            return X, w
        mean = w @ X
        d = X - mean
        P = d.T @ (w[:, None] * d) + 1e-9 * np.eye(4)
        X = X[self.generator.choice(self.n, self.n, p=w)]
        h = 0.5 * self.n ** (-1 / 8)  # of a Gaussian kernel in four dimensions; shrunk, so that the covariance stays
        X = mean + np.sqrt(1 - h**2) * (X - mean) + h * self.generator.multivariate_normal(np.zeros(4), P, self.n)
        return X, np.full(self.n, 1 / self.n)
