"""Interacting models that differ by a known push along or across the velocity: none, brake, throttle, left, right."""

import numpy as np
from benchmarks.faults.parts import first, linear_at, push, transition, with_gain

PUSHES = np.array([[0.0, 0.0], [-2.5, 0.0], [2.5, 0.0], [0.0, 3.0], [0.0, -3.0]])  # m/s^2, along and to the left
SIGMA = np.array([1.2, 2.0, 2.0, 2.0, 2.0])
RATE = 0.6  # changes per second
M = len(PUSHES)


def combined(w, X, V):
    x = w @ X
    d = X - x
    P = np.einsum("m,mij->ij", w, V) + np.einsum("m,mi,mj->ij", w, d, d)
    return x, (P + P.T) / 2 + 1e-9 * np.eye(4)


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            w, X, V = np.full(M, 1 / M), np.tile(x, (M, 1)), np.tile(P, (M, 1, 1))
        else:
            time, w, X, V = state
            w, X, V = self.predicted(w, X, V, scan.time - time)
            if scan.valid:
                w, X, V = self.corrected(w, X, V, scan)
        return (scan.time, w, X, V), combined(w, X, V)

    def predicted(self, w, X, V, dt):
        stay = np.exp(-RATE * dt)
        T = stay * np.eye(M) + (1 - stay) / M
        joint = w[:, None] * T
        after = joint.sum(axis=0)
        starts = [combined(joint[:, j] / after[j], X, V) for j in range(M)]
        F, G = transition(dt), push(dt)
        X, V = np.empty_like(X), np.empty_like(V)
        for j, (x, P) in enumerate(starts):
            speed = np.hypot(x[2], x[3])
            known = speed**2 / (speed**2 + np.trace(P[2:, 2:]))  # how far the course is
            c, s = x[2:] / max(speed, 0.1)
            a = known * np.array([[c, -s], [s, c]]) @ PUSHES[j]
            X[j], V[j] = F @ x + G @ a, F @ P @ F.T + SIGMA[j] ** 2 * G @ G.T
        return after, X, V

    def corrected(self, w, X, V, scan):
        X, V, score = X.copy(), V.copy(), np.log(w)
        z, H, R = linear_at(scan, w @ X[:, 2:])
        R = R + 1e-6 * np.eye(len(z))
        for j in range(M):
            y, S = z - H @ X[j], H @ V[j] @ H.T + R
            score[j] -= (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1]) / 2
            X[j], V[j] = with_gain(X[j], V[j], np.linalg.solve(S, H @ V[j]).T, y, H, R)
        w = np.maximum(np.exp(score - score.max()), 1e-6)
        return w / w.sum(), X, V
