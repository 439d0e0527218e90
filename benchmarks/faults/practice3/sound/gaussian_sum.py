"""A Gaussian sum: one measurement in 20 is thought to have three times the noise; three terms are kept."""

from itertools import combinations
from math import exp, log

import numpy as np
from benchmarks.faults.parts import first, linear_at, moved, with_gain

NOISES = ((0.95, 1.0), (0.05, 9.0))


def joined(terms):
    """Weight, mean and covariance of several terms together."""
    w = sum(t[0] for t in terms)
    x = sum(t[0] * t[1] for t in terms) / w
    P = sum(t[0] * (t[2] + np.outer(t[1] - x, t[1] - x)) for t in terms) / w
    return w, x, (P + P.T) / 2


def loss(a, b):
    """Runnalls' bound of what is lost when two terms become one."""
    w, _, P = joined([a, b])
    return w * log_det(P) - a[0] * log_det(a[2]) - b[0] * log_det(b[2])


def log_det(P):
    return np.linalg.slogdet(P)[1]


class Tracker:
    most = 3

    def step(self, state, scan):
        if state is None:
            terms = [(1.0, *first(scan))]
        else:
            time, terms = state
            terms = [(w, *moved(x, P, scan.time - time)) for w, x, P in terms]
            if scan.valid:
                terms = self.reduced(self.weighed(terms, scan))
        return (scan.time, terms), joined(terms)[1:]

    def weighed(self, terms, scan):
        found = []
        for w, x, P in terms:
            z, H, R = linear_at(scan, x[2:])
            y = z - H @ x
            for share, scale in NOISES:
                S = H @ P @ H.T + scale * R
                K = np.linalg.solve(S, H @ P).T
                score = log(w * share) - (y @ np.linalg.solve(S, y) + log_det(S)) / 2
                found.append((score, *with_gain(x, P, K, y, H, scale * R)))
        best = max(f[0] for f in found)
        total = sum(exp(f[0] - best) for f in found)
        return [(exp(s - best) / total, x, P) for s, x, P in found if s > best - 20.0]

    def reduced(self, terms):
        while len(terms) > self.most:
            i, j = min(combinations(range(len(terms)), 2), key=lambda pair: loss(terms[pair[0]], terms[pair[1]]))
            terms = [t for k, t in enumerate(terms) if k not in (i, j)] + [joined([terms[i], terms[j]])]
        return terms
