"""An interacting multiple model filter of two constant-velocity models, one quiet and one lively."""

import numpy as np


class Model:
    """An extended Kalman filter whose state the bank exchanges."""

    def __init__(self, sigma):
        self.sigma = sigma
        self.x = np.zeros(4)
        self.P = np.eye(4)
        self.likelihood = 1.0

    def predict(self, dt):
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        self.x = F @ self.x
        self.P = F @ self.P @ F.T + self.sigma**2 * G @ G.T

    def update(self, scan):
        y, H = innovation(self.x, scan)
        S = H @ self.P @ H.T + scan.noise_covariance
        K = self.P @ H.T @ np.linalg.inv(S)
        self.x = self.x + K @ y
        A = np.eye(4) - K @ H
        self.P = A @ self.P @ A.T + K @ scan.noise_covariance @ K.T
        density = np.exp(-0.5 * y @ np.linalg.solve(S, y)) / np.sqrt(np.linalg.det(2 * np.pi * S))
        self.likelihood = max(density, 1e-300)


def innovation(x, scan):
    d = x[:2] - scan.sensor_pose[:2]
    yaw = scan.sensor_pose[2]
    if scan.kind == "lidar":
        T = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        return scan.measurement - T @ d, np.hstack([T, np.zeros((2, 2))])
    r = max(np.linalg.norm(d), 1e-3)
    u = d / r
    v = x[2:] - scan.sensor_velocity
    y = scan.measurement - [r, np.arctan2(d[1], d[0]) - yaw, u @ v]
    y[1] = (y[1] + np.pi) % (2 * np.pi) - np.pi
    across = np.array([-u[1], u[0]])
    H = np.zeros((3, 4))
    H[0, :2] = u
    H[1, :2] = across / r
    H[2, :2] = (across @ v) * across / r
    H[2, 2:] = u
    return y, H


class Tracker:
    def __init__(self, sigmas=(1.0, 6.0), stay=0.97):
        self.models = [Model(sigma) for sigma in sigmas]
        M = len(sigmas)
        self.M = np.full((M, M), (1 - stay) / (M - 1))  # [i, j]: from model i to model j
        np.fill_diagonal(self.M, stay)
        self.mu = np.full(M, 1 / M)
        self.time = None

    def step(self, state, scan):
        if self.time is None:
            self.start(scan)
        else:
            self.mix()
            for model in self.models:
                model.predict(scan.time - self.time)
            if scan.valid:
                self.update(scan)
        self.time = scan.time
        return None, self.combined()

    def start(self, scan):
        yaw = scan.sensor_pose[2]
        radar = scan.kind == "radar"
        r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if radar else (1.0, yaw)
        J = np.array([[np.cos(angle), -r * np.sin(angle)], [np.sin(angle), r * np.cos(angle)]])
        position = J @ ([r, 0.0] if radar else scan.measurement)
        for model in self.models:
            model.x = np.concatenate([scan.sensor_pose[:2] + position, np.zeros(2)])
            model.P = np.diag([0.0, 0.0, 400.0, 400.0])
            model.P[:2, :2] = J @ scan.noise_covariance[:2, :2] @ J.T

    def mix(self):
        c = self.mu @ self.M  # probability of each model now
        w = self.M * self.mu[:, None] / c  # [i, j]: that it was model i, where it is model j now
        xs = [sum(w[i, j] * self.models[i].x for i in range(len(self.mu))) for j in range(len(self.mu))]
        Ps = []
        for j in range(len(self.mu)):
            P = np.zeros((4, 4))
            for i, model in enumerate(self.models):
                d = model.x - xs[j]
                P += w[i, j] * (model.P + np.outer(d, d))
            Ps.append(P)
        for model, x, P in zip(self.models, xs, Ps, strict=True):
            model.x, model.P = x, P
        self.mu = c

    def update(self, scan):
        for model in self.models:
            model.update(scan)
        self.mu = self.mu * [model.likelihood for model in self.models]
        self.mu = self.mu / self.mu.sum()

    def combined(self):
        x = sum(m * model.x for m, model in zip(self.mu, self.models, strict=True))
        P = np.zeros((4, 4))
        for m, model in zip(self.mu, self.models, strict=True):
            d = model.x - x
            P += m * (model.P + np.outer(d, d))
        return x, P
