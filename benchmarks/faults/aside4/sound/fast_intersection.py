"""Two trackers, one a sensor, which do not know each other; what they say is joined by covariance intersection."""

import numpy as np
from benchmarks.faults.parts import constant_velocity, difference, expected, first


class Local:
    """What one sensor knows."""

    def __init__(self, time, x, P):
        self.time, self.x, self.P = time, x, P

    def at(self, time):
        F, Q = constant_velocity(time - self.time)
        return Local(time, F @ self.x, F @ self.P @ F.T + Q)

    def given(self, scan):
        predicted, H = expected(self.x, scan)
        S = H @ self.P @ H.T + scan.noise_covariance
        K = np.linalg.solve(S, H @ self.P).T
        P = self.P - K @ S @ K.T
        x = self.x + K @ difference(scan.measurement, predicted, scan)
        return Local(scan.time, x, (P + P.T) / 2)


def joined(a, b):
    """With the weights in closed form, from the determinants of the information."""
    A, B = np.linalg.inv(a.P), np.linalg.inv(b.P)
    both, one, other = (np.linalg.slogdet(M)[1] for M in (A + B, A, B))
    one, other = np.exp(one - both), np.exp(other - both)
    w = (1 + one - other) / 2  # of the one, as it is in the range from 0 to 1 by itself
    w = min(max(w, 0.0), 1.0)
    P = np.linalg.inv(w * A + (1 - w) * B)
    return P @ (w * A @ a.x + (1 - w) * B @ b.x), (P + P.T) / 2


class Tracker:
    def step(self, state, scan):
        known = dict(state or {})
        for kind in known:
            known[kind] = known[kind].at(scan.time)
        if scan.valid and scan.kind in known:
            known[scan.kind] = known[scan.kind].given(scan)
        elif scan.valid:
            known[scan.kind] = Local(scan.time, *first(scan))
        told = list(known.values())
        if len(told) == 1:
            return known, (told[0].x, told[0].P)
        return known, joined(*told)
