"""A bootstrap particle filter with systematic resampling and a little jitter. It draws random numbers."""

import numpy as np
from benchmarks.faults.parts import position


class Tracker:
    random = True

    def __init__(self, particles=2000, acceleration_sigma=4.0):
        self.n, self.sigma = particles, acceleration_sigma
        self.rng = np.random.default_rng()

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            X = np.empty((4, self.n))
            X[:2] = z[:, None] + np.linalg.cholesky(R) @ self.rng.standard_normal((2, self.n))
            X[2:] = self.start_velocities(scan)
            return (scan.time, X), self.moments(X)
        time, X = state
        dt = scan.time - time
        push = self.sigma * self.rng.standard_normal((2, self.n))
        X = X.copy()
        X[:2] += dt * X[2:] + dt**2 / 2 * push
        X[2:] += dt * push
        if scan.valid:
            z, R = position(scan)
            gap = z[:, None] - X[:2]
            log = -0.5 * np.einsum("in,ij,jn->n", gap, np.linalg.inv(R), gap)
            if scan.kind == "radar":
                ray = X[:2] - scan.sensor_pose[:2, None]
                rate = (ray * (X[2:] - scan.sensor_velocity[:, None])).sum(axis=0) / np.hypot(*ray)
                log -= 0.5 * (scan.measurement[2] - rate) ** 2 / (scan.noise_covariance[2, 2] + 0.05)
            weight = np.exp(log - log.max())
            X = self.resampled(X, weight / weight.sum())
        return (scan.time, X), self.moments(X)

    def start_velocities(self, scan):
        V = 15.0 * self.rng.standard_normal((2, self.n))
        if scan.kind != "radar":
            return V
        angle = scan.sensor_pose[2] + scan.measurement[1]
        ray = np.array([np.cos(angle), np.sin(angle)])
        rate = scan.measurement[2] + ray @ scan.sensor_velocity + 0.3 * self.rng.standard_normal(self.n)
        return V + np.outer(ray, rate - ray @ V)

    def resampled(self, X, weight):
        places = (np.arange(self.n) + self.rng.random()) / self.n
        chosen = np.minimum(np.searchsorted(np.cumsum(weight), places), self.n - 1)
        jitter = np.array([0.02, 0.02, 0.05, 0.05])[:, None] * self.rng.standard_normal((4, self.n))
        return X[:, chosen] + jitter

    def moments(self, X):
        return X.mean(axis=1), np.cov(X) + 1e-6 * np.eye(4)
