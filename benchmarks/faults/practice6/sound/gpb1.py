"""The generalised pseudo-Bayesian filter of first order: one belief, from which every model starts at each scan."""

import numpy as np
from benchmarks.faults.parts import constant_velocity, first, linear_at, updated

SIGMAS = np.array([2.8, 4.5, 8.0])  # m/s^2
LENGTH = 1.5  # s that a model lasts
START = np.array([0.5, 0.3, 0.2])


class Belief:
    def __init__(self, time, x, P, odds):
        self.time, self.x, self.P, self.odds = time, x, P, odds

    def after(self, scan):
        dt = scan.time - self.time
        stay = np.exp(-dt / LENGTH)
        odds = stay * self.odds + (1 - stay) * START
        branches = []
        for sigma in SIGMAS:
            F, Q = constant_velocity(dt, sigma)
            branches.append((F @ self.x, F @ self.P @ F.T + Q))
        if scan.valid:
            score = np.log(odds)
            for k, (x, P) in enumerate(branches):
                z, H, R = linear_at(scan, x[2:])
                y, S = z - H @ x, H @ P @ H.T + R
                score[k] -= 0.5 * (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1])
                branches[k] = updated(x, P, z, H, R)
            odds = np.exp(score - score.max()) + 1e-9
            odds /= odds.sum()
        x = sum(w * m for w, (m, _) in zip(odds, branches, strict=True))
        P = sum(w * (C + np.outer(m - x, m - x)) for w, (m, C) in zip(odds, branches, strict=True))
        return Belief(scan.time, x, (P + P.T) / 2, odds)


class Tracker:
    def step(self, state, scan):
        belief = Belief(scan.time, *first(scan), START) if state is None else state.after(scan)
        return belief, (belief.x, belief.P)
