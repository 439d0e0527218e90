"""Three models by name, "straight", "left" and "right", whose probabilities are kept as logarithms."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

NAMES = ("straight", "left", "right")
STAY = {
    "straight": {"straight": 0.96, "left": 0.02, "right": 0.02},
    "left": {"straight": 0.10, "left": 0.89, "right": 0.01},
    "right": {"straight": 0.10, "left": 0.01, "right": 0.89},
}
TURN = {"straight": 0.0, "left": np.deg2rad(12.0), "right": -np.deg2rad(12.0)}
NOISE = {"straight": 2.2, "left": 9.0, "right": 9.0}  # m/s^2


@dataclass(frozen=True)
class Gaussian:
    mean: np.ndarray
    cov: np.ndarray


def merge(parts, weights):
    """One Gaussian with the moments of a mixture."""
    mean = sum(w * parts[n].mean for n, w in weights.items())
    cov = np.zeros((4, 4))
    for n, w in weights.items():
        d = parts[n].mean - mean
        cov += w * (parts[n].cov + np.outer(d, d))
    return Gaussian(mean, cov)


def motion(name, dt):
    w = TURN[name]
    F = np.eye(4)
    if w == 0.0:
        F[0, 2] = F[1, 3] = dt
    else:
        s, c = np.sin(w * dt), np.cos(w * dt)
        F[:2, 2:] = np.array([[s, c - 1.0], [1.0 - c, s]]) / w
        F[2:, 2:] = [[c, -s], [s, c]]
    G = np.vstack([np.eye(2) * dt**2 / 2, np.eye(2) * dt])
    return F, NOISE[name] ** 2 * G @ G.T


def sees(mean, scan):
    """Expected measurement and its derivative."""
    yaw = scan.sensor_pose[2]
    d = mean[:2] - scan.sensor_pose[:2]
    if scan.kind != "radar":
        A = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        return A @ d, np.hstack([A, np.zeros((2, 2))])
    u = mean[2:] - scan.sensor_velocity
    r = np.sqrt(d @ d)
    rate = d @ u / r
    H = np.zeros((3, 4))
    H[0, :2] = d / r
    H[1, :2] = np.array([-d[1], d[0]]) / r**2
    H[2, :2] = u / r - rate * d / r**2
    H[2, 2:] = d / r
    return np.array([r, np.arctan2(d[1], d[0]) - yaw, rate]), H


class Tracker:
    def step(self, state, scan):
        if state is None:
            first = self.first(scan)
            models = dict.fromkeys(NAMES, first)
            log_mu = {"straight": np.log(0.8), "left": np.log(0.1), "right": np.log(0.1)}
            return (scan.time, models, log_mu), (first.mean, first.cov)
        time, models, log_mu = state
        models, log_mu = self.interact(models, log_mu)
        models = {name: self.predict(g, name, scan.time - time) for name, g in models.items()}
        if scan.valid:
            for name in NAMES:
                models[name], log_likelihood = self.update(models[name], scan)
                log_mu[name] = log_mu[name] + log_likelihood
            total = logsumexp(list(log_mu.values()))
            log_mu = {name: value - total for name, value in log_mu.items()}
        out = merge(models, {name: np.exp(value) for name, value in log_mu.items()})
        return (scan.time, models, log_mu), (out.mean, out.cov)

    def first(self, scan):
        a = scan.sensor_pose[2]
        z, R = scan.measurement, scan.noise_covariance
        if scan.kind == "radar":
            a = a + z[1]
            z, R = np.array([z[0], 0.0]), np.diag([R[0, 0], z[0] ** 2 * R[1, 1]])
        T = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
        cov = np.diag([0.0, 0.0, 20.0**2, 20.0**2])
        cov[:2, :2] = T @ R @ T.T
        return Gaussian(np.append(scan.sensor_pose[:2] + T @ z, [0.0, 0.0]), cov)

    def interact(self, models, log_mu):
        """Probabilities ahead of the measurement, and the mixture that each model starts from."""
        ahead, mixed = {}, {}
        for to in NAMES:
            joint = {source: log_mu[source] + np.log(STAY[source][to]) for source in NAMES}
            ahead[to] = logsumexp(list(joint.values()))
            weights = {source: np.exp(value - ahead[to]) for source, value in joint.items()}
            mean = sum(weights[source] * models[source].mean for source in NAMES)
            cov = np.zeros((4, 4))
            for source in NAMES:
                gap = models[source].mean - mean
                cov = cov + weights[source] * (models[source].cov + np.outer(gap, gap))
            mixed[to] = Gaussian(mean, cov)
        return mixed, ahead

    def predict(self, g, name, dt):
        F, Q = motion(name, dt)
        return replace(g, mean=F @ g.mean, cov=F @ g.cov @ F.T + Q)

    def update(self, g, scan):
        expected, H = sees(g.mean, scan)
        v = scan.measurement - expected
        if scan.kind == "radar":
            v[1] = (v[1] + np.pi) % (2.0 * np.pi) - np.pi
        R = scan.noise_covariance
        S = H @ g.cov @ H.T + R
        W = np.linalg.solve(S, H @ g.cov).T
        A = np.eye(4) - W @ H
        distance = v @ np.linalg.solve(S, v)
        log_det = np.linalg.slogdet(S)[1]
        log_likelihood = -0.5 * (distance + log_det + len(v) * np.log(2.0 * np.pi))
        return Gaussian(g.mean + W @ v, A @ g.cov @ A.T + W @ R @ W.T), log_likelihood
