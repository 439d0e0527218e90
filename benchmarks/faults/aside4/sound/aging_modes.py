"""Cruise and manoeuvre interact, each in three phases that follow on one another: it lasts a while."""

import numpy as np
from benchmarks.faults.parts import first, linear_at, moved, with_gain
from scipy.linalg import expm

MODES = ((1.5, 3.0), (4.0, 1.5))  # sigma in m/s^2, mean duration in s
PHASES = 3
SIGMA = np.repeat([m[0] for m in MODES], PHASES)


def generator():
    n = 2 * PHASES
    A = np.zeros((n, n))
    for k in range(n):
        rate = PHASES / MODES[k // PHASES][1]
        A[k, k], A[k, (k + 1) % n] = -rate, rate
    return A


RATES = generator()


def moments(w, beliefs):
    x = sum(a * b[0] for a, b in zip(w, beliefs, strict=True))
    P = sum(a * (b[1] + np.outer(b[0] - x, b[0] - x)) for a, b in zip(w, beliefs, strict=True))
    return x, (P + P.T) / 2 + 1e-9 * np.eye(4)


class Tracker:
    def step(self, state, scan):
        if state is None:
            w, beliefs = np.full(len(RATES), 1 / len(RATES)), [first(scan)] * len(RATES)
        else:
            time, w, beliefs = state
            w, beliefs = self.predicted(w, beliefs, scan.time - time)
            if scan.valid:
                w, beliefs = self.corrected(w, beliefs, scan)
        return (scan.time, w, beliefs), moments(w, beliefs)

    def predicted(self, w, beliefs, dt):
        joint = w[:, None] * expm(RATES * dt)
        after = joint.sum(axis=0)
        starts = [moments(joint[:, k] / after[k], beliefs) for k in range(len(after))]
        return after, [moved(*start, dt, sigma) for start, sigma in zip(starts, SIGMA, strict=True)]

    def corrected(self, w, beliefs, scan):
        score, after = np.log(w), []
        for k, (x, P) in enumerate(beliefs):
            z, H, R = linear_at(scan, x[2:])
            R = R + 1e-6 * np.eye(len(z))
            S = H @ P @ H.T + R
            y = z - H @ x
            score[k] -= (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1]) / 2
            after.append(with_gain(x, P, np.linalg.solve(S, H @ P).T, y, H, R))
        w = np.exp(score - score.max()) + 1e-7
        return w / w.sum(), after
