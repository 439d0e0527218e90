"""Sequences of two models: each is continued by both, the eight best are kept, and nothing is mixed but the output."""

import numpy as np
from benchmarks.faults.parts import constant_velocity, first, linear_at, updated

SIGMAS = (1.6, 5.0)  # m/s^2
STAY_S = (2.5, 1.2)
KEPT = 8


class Tracker:
    def step(self, state, scan):
        if state is None:
            branches = [(np.log(0.5), model, *first(scan)) for model in (0, 1)]
        else:
            time, branches = state
            branches = self.continued(branches, scan.time - time)
            if scan.valid:
                branches = [self.measured(branch, scan) for branch in branches]
            branches = self.pruned(branches)
        return (scan.time, branches), self.together(branches)

    def continued(self, branches, dt):
        """Where no time passes, the model cannot have changed."""
        after = []
        for score, old, x, P in branches:
            change = 0.5 * (1 - np.exp(-2 * dt / STAY_S[old]))
            for new in (0, 1):
                chance = 1 - change if new == old else change
                if chance > 0:
                    F, Q = constant_velocity(dt, SIGMAS[new])
                    after.append((score + np.log(chance), new, F @ x, F @ P @ F.T + Q))
        return after

    def measured(self, branch, scan):
        score, model, x, P = branch
        z, H, R = linear_at(scan, x[2:])
        R = R + 1e-6 * np.eye(len(z))
        y, S = z - H @ x, H @ P @ H.T + R
        score -= (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1]) / 2
        return (score, model, *updated(x, P, z, H, R))

    def pruned(self, branches):
        """Each model keeps one branch at least."""
        ranked = sorted(branches, key=lambda b: -b[0])
        kept = ranked[:KEPT]
        for model in (0, 1):
            if all(b[1] != model for b in kept):
                kept.append(next(b for b in ranked if b[1] == model))
        top = kept[0][0]
        return [(max(score - top, -12.0), model, x, (P + P.T) / 2 + 1e-10 * np.eye(4)) for score, model, x, P in kept]

    def together(self, branches):
        w = np.exp([b[0] for b in branches])
        w /= w.sum()
        x = sum(a * b[2] for a, b in zip(w, branches, strict=True))
        P = sum(a * (b[3] + np.outer(b[2] - x, b[2] - x)) for a, b in zip(w, branches, strict=True))
        return x, (P + P.T) / 2
