"""Two interacting models of different size: constant velocity (4 states) and constant acceleration (6 states)."""

import numpy as np
from benchmarks.faults.parts import first, linear_at, push, transition, with_gain


class Model:
    """A model of the first ``size`` of px, py, vx, vy, ax, ay."""

    def __init__(self, size, sigma, stay_s):
        self.size, self.sigma, self.stay_s = size, sigma, stay_s

    def predict(self, x, P, dt):
        F, Q = np.eye(self.size), np.zeros((self.size, self.size))
        F[:4, :4] = transition(dt)
        if self.size == 4:
            G = self.sigma * push(dt)
        else:
            F[:4, 4:] = push(dt)
            G = self.sigma * np.sqrt(dt) * np.vstack([dt**2 / 6 * np.eye(2), dt / 2 * np.eye(2), np.eye(2)])
        Q = G @ G.T
        return F @ x, F @ P @ F.T + Q


MODELS = (Model(4, 1.0, 2.0), Model(6, 4.0, 1.5))  # sigma in m/s^2, and in m/s^2 per root second
UNKNOWN = 3.0  # m/s^2, the acceleration of a track that comes from the model without one


def resized(x, P, size):
    n = len(x)
    if n >= size:
        return x[:size], P[:size, :size]
    whole = np.diag(np.full(size, UNKNOWN**2))
    whole[:n, :n] = P
    return np.append(x, np.zeros(size - n)), whole


def moments(weights, beliefs):
    x = sum(w * b[0] for w, b in zip(weights, beliefs, strict=True))
    P = sum(w * (b[1] + np.outer(b[0] - x, b[0] - x)) for w, b in zip(weights, beliefs, strict=True))
    return x, (P + P.T) / 2


class Tracker:
    def step(self, state, scan):
        if state is None:
            mu, bank = np.array([0.5, 0.5]), [resized(*first(scan), model.size) for model in MODELS]
        else:
            time, mu, bank = state
            mu, bank = self.predicted(mu, bank, scan.time - time)
            if scan.valid:
                mu, bank = self.corrected(mu, bank, scan)
        return (scan.time, mu, bank), moments(mu, [resized(*belief, 4) for belief in bank])

    def predicted(self, mu, bank, dt):
        leave = [1 - np.exp(-dt / model.stay_s) for model in MODELS]
        T = np.array([[1 - leave[0], leave[0]], [leave[1], 1 - leave[1]]])
        joint = mu[:, None] * T
        after = joint.sum(axis=0)
        mixed = []
        for j, model in enumerate(MODELS):
            x, P = moments(joint[:, j] / after[j], [resized(*belief, model.size) for belief in bank])
            mixed.append(model.predict(x, P, dt))
        return after, mixed

    def corrected(self, mu, bank, scan):
        score, after = np.log(mu), []
        for k, (x, P) in enumerate(bank):
            z, H, R = linear_at(scan, x[2:4])
            H = np.pad(H, ((0, 0), (0, len(x) - 4)))
            y, S = z - H @ x, H @ P @ H.T + R
            score[k] -= (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1]) / 2
            after.append(with_gain(x, P, np.linalg.solve(S, H @ P).T, y, H, R))
        mu = np.maximum(np.exp(score - score.max()), 1e-6)
        return mu / mu.sum(), after
