"""The generalised pseudo-Bayesian filter of second order: a filter for each pair of the last model and the present."""

from itertools import product

import numpy as np
from benchmarks.faults.parts import constant_velocity, first, linear_at, updated

SIGMAS = (2.2, 7.0)  # m/s^2: calm, and when it brakes or turns
STAY = (1.5, 1.0)  # s


def collapse(terms):
    """Logarithm of the weight, mean and covariance of the sum."""
    logs = np.array([log for log, _, _ in terms])
    top = logs.max()
    w = np.exp(logs - top)
    total = w.sum()
    w /= total
    x = sum(share * m for share, (_, m, _) in zip(w, terms, strict=True))
    P = sum(share * (C + np.outer(m - x, m - x)) for share, (_, m, C) in zip(w, terms, strict=True))
    return top + np.log(total), x, (P + P.T) / 2


def change(i, j, dt):
    stay = 0.5 + 0.5 * np.exp(-2 * dt / STAY[i])
    return stay if i == j else max(1 - stay, 1e-12)


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            modes = [(np.log(0.5), x, P), (np.log(0.5), x, P)]
        else:
            modes = self.advanced(*state, scan)
        _, x, P = collapse(modes)
        return (scan.time, modes), (x, P)

    def advanced(self, time, modes, scan):
        dt = scan.time - time
        pairs = {}
        for (i, (log, x, P)), (j, sigma) in product(enumerate(modes), enumerate(SIGMAS)):
            F, Q = constant_velocity(dt, sigma)
            x, P = F @ x, F @ P @ F.T + Q
            log = log + np.log(change(i, j, dt))
            if scan.valid:
                z, H, R = linear_at(scan, x[2:])
                y, S = z - H @ x, H @ P @ H.T + R
                log -= (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1]) / 2
                x, P = updated(x, P, z, H, R)
            pairs[i, j] = log, x, P
        modes = [collapse([pairs[0, j], pairs[1, j]]) for j in range(2)]
        whole = np.logaddexp(modes[0][0], modes[1][0])
        return [(max(log - whole, -20.0), x, P) for log, x, P in modes]
