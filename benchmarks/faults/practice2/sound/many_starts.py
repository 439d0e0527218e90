"""A bank of filters that start with different velocities; it returns their mixture and lets the unlikely ones die."""

import itertools

import numpy as np
from benchmarks.faults import parts

SPEEDS = (-24.0, -12.0, 0.0, 12.0, 24.0)
SPREAD = 7.0  # of the velocity of each, m/s


class Tracker:
    """The mixture of the starts has about the covariance of one broad start."""

    def step(self, state, scan):
        if state is None:
            z, R = parts.position(scan)
            P = np.diag([0.0, 0.0, SPREAD**2, SPREAD**2])
            P[:2, :2] = R
            bank = [(0.0, np.array([*z, *v]), P) for v in itertools.product(SPEEDS, SPEEDS)]
        else:
            time, bank = state
            bank = [(w, *parts.moved(x, P, scan.time - time)) for w, x, P in bank]
            if scan.valid:
                bank = [self.corrected(*one, scan) for one in bank]
        best = max(w for w, _, _ in bank)
        bank = [(w - best, x, P) for w, x, P in bank if w > best - 25.0]
        weights = np.exp([w for w, _, _ in bank])
        weights /= weights.sum()
        x = sum(w * one[1] for w, one in zip(weights, bank, strict=True))
        P = sum(w * (one[2] + np.outer(one[1] - x, one[1] - x)) for w, one in zip(weights, bank, strict=True))
        return (scan.time, bank), (x, (P + P.T) / 2)

    def corrected(self, w, x, P, scan):
        h, H = parts.expected(x, scan)
        R = scan.noise_covariance
        y = parts.difference(scan.measurement, h, scan)
        S = H @ P @ H.T + R
        w = w - (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1]) / 2
        x, P = parts.with_gain(x, P, np.linalg.solve(S, H @ P).T, y, H, R)
        return w, x, (P + P.T) / 2
