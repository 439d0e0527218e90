"""Three interacting models: straight on, a bend to the left and one to the right, of known turn rates."""

import numpy as np
from benchmarks.faults import parts

from trackbench.base.types import Estimate

TURNS = np.radians([0.0, 14.0, -14.0])  # per second
SIGMAS = np.array([2.0, 3.0, 3.0])  # m/s^2
RATES = np.array([[-0.5, 0.25, 0.25], [0.7, -0.8, 0.1], [0.7, 0.1, -0.8]])  # of the changes, per second


def turned(turn, dt):
    if turn == 0:
        return parts.transition(dt)
    a = turn * dt
    s, c = np.sin(a), np.cos(a)
    F = np.eye(4)
    F[:2, 2:] = np.array([[s, c - 1], [1 - c, s]]) / turn
    F[2:, 2:] = [[c, -s], [s, c]]
    return F


def changes(dt):
    """Probabilities of the changes in an interval: by squaring that of a short one."""
    T = np.eye(3) + RATES * dt / 64
    for _ in range(6):
        T = T @ T
    return T


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = parts.first(scan)
            mu, X, C = np.array([0.8, 0.1, 0.1]), np.tile(x, (3, 1)), np.tile(P, (3, 1, 1))
        else:
            time, mu, X, C = state
            dt = scan.time - time
            joint = mu[:, None] * changes(dt)
            mu = joint.sum(axis=0)
            mixed = [merged(joint[:, k] / mu[k], X, C) for k in range(3)]
            X, C = self.predicted(mixed, dt)
            if scan.valid:
                mu, X, C = self.corrected(mu, X, C, scan)
        mean, P = merged(mu, X, C)
        return (scan.time, mu, X, C), Estimate(mean, P, mode_probabilities=mu)

    def predicted(self, mixed, dt):
        G = parts.push(dt)
        X, C = [], []
        for (x, P), turn, sigma in zip(mixed, TURNS, SIGMAS, strict=True):
            F = turned(turn, dt)
            X.append(F @ x)
            C.append(F @ P @ F.T + sigma**2 * G @ G.T)
        return np.array(X), np.array(C)

    def corrected(self, mu, X, C, scan):
        z, H, R = parts.linear_at(scan, mu @ X[:, 2:])
        Y = z - X @ H.T
        S = H @ C @ H.T + R
        K = np.linalg.solve(S, H @ C).transpose(0, 2, 1)
        score = np.log(mu) - np.einsum("ki,ki->k", Y, np.linalg.solve(S, Y[:, :, None])[:, :, 0]) / 2
        score -= np.linalg.slogdet(S)[1] / 2
        likely = np.exp(score - score.max()) + 1e-9
        A = np.eye(4) - K @ H
        C = A @ C @ A.transpose(0, 2, 1) + K @ R @ K.transpose(0, 2, 1)
        return likely / likely.sum(), X + np.einsum("kij,kj->ki", K, Y), C


def merged(weights, X, C):
    x = weights @ X
    D = X - x
    P = np.einsum("k,kij->ij", weights, C) + np.einsum("k,ki,kj->ij", weights, D, D)
    return x, (P + P.T) / 2
