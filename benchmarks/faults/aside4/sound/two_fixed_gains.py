"""Interacting alpha-beta filters, a calm one and a quick one, each with the covariance that its fixed gains give."""

import numpy as np
from benchmarks.faults.parts import first, moved, position, with_gain

MODELS = ((0.22, 0.03, 1.0), (0.55, 0.25, 5.0))  # alpha, beta, sigma of the acceleration in m/s^2
STAY_S = (2.0, 1.0)


def mixed(w, beliefs):
    x = sum(a * b[0] for a, b in zip(w, beliefs, strict=True))
    return x, sum(a * (b[1] + np.outer(b[0] - x, b[0] - x)) for a, b in zip(w, beliefs, strict=True))


class Tracker:
    def step(self, state, scan):
        if state is None:
            belief = first(scan)
            state = (scan.time, scan.time, 1, np.array([0.5, 0.5]), (belief, belief))
            return state, belief
        time, since, count, w, beliefs = state
        w, beliefs = self.predicted(w, beliefs, scan.time - time)
        if scan.valid:
            w, beliefs = self.corrected(w, beliefs, scan, scan.time - since, count + 1)
            since, count = scan.time, count + 1
        return (scan.time, since, count, w, beliefs), mixed(w, beliefs)

    def predicted(self, w, beliefs, dt):
        leave = 0.5 * (1 - np.exp(-2 * dt / np.array(STAY_S)))
        T = np.array([[1 - leave[0], leave[0]], [leave[1], 1 - leave[1]]])
        joint = w[:, None] * T
        w = joint.sum(axis=0)
        starts = [mixed(joint[:, j] / w[j], beliefs) for j in range(2)]
        return w, tuple(moved(*start, dt, MODELS[j][2]) for j, start in enumerate(starts))

    def corrected(self, w, beliefs, scan, dt, count):
        z, R = position(scan)
        H = np.eye(2, 4)
        after, score = [], np.log(w)
        for j, (x, P) in enumerate(beliefs):
            alpha = max(MODELS[j][0], 2 * (2 * count - 1) / (count * (count + 1)))  # those of a line at the start
            beta = max(MODELS[j][1], 6 / (count * (count + 1)))
            K = np.vstack([min(alpha, 1.0) * np.eye(2), (beta / dt if dt > 1e-3 else 0.0) * np.eye(2)])
            y, S = z - x[:2], P[:2, :2] + R
            score[j] -= (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1]) / 2
            after.append(with_gain(x, P, K, y, H, R))
        w = np.maximum(np.exp(score - score.max()), 1e-4)
        return w / w.sum(), tuple(after)
