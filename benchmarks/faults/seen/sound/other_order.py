"""A sequential update of decorrelated components, with the state px, vx, py, vy."""

import numpy as np
from benchmarks.faults.parts import Filter, first, linear_at

ORDER = [0, 2, 1, 3]  # from px, py, vx, vy and back


class Tracker(Filter):
    def started(self, scan):
        return self.output(*first(scan))

    def predicted(self, s, C, dt):
        f = np.array([[1.0, dt], [0.0, 1.0]])
        q = 9.0 * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
        F = np.kron(np.eye(2), f)
        return F @ s, F @ C @ F.T + np.kron(np.eye(2), q)

    def corrected(self, s, C, scan):
        z, H, R = linear_at(scan, s[ORDER][2:])
        L = np.linalg.cholesky(R)
        for value, h in zip(np.linalg.solve(L, z), np.linalg.solve(L, H[:, ORDER]), strict=True):
            k = C @ h / (h @ C @ h + 1.0)
            s = s + k * (value - h @ s)
            C = C - np.outer(k, h @ C)
        return s, (C + C.T) / 2

    def output(self, s, C):
        return s[ORDER], C[np.ix_(ORDER, ORDER)]
