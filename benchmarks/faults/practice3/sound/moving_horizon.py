"""Least squares over the latest scans: the unknowns are the state where they begin and each acceleration since.

What is older is kept as the belief at the beginning.
"""

import numpy as np
from benchmarks.faults.parts import first, linear_at, moved, push, transition, updated


class Tracker:
    def __init__(self, horizon=8, sigma=3.0):
        self.horizon, self.sigma = horizon, sigma

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            state = (scan.time, x, P), []
        else:
            begin, scans = state
            scans = [*scans, scan]
            if len(scans) > self.horizon:
                begin = self.absorbed(begin, scans.pop(0))
            state = begin, scans
        return state, self.solved(*state)

    def absorbed(self, begin, scan):
        time, x, P = begin
        x, P = moved(x, P, scan.time - time, self.sigma)
        if scan.valid:
            x, P = updated(x, P, *linear_at(scan, x[2:]))
        return scan.time, x, (P + P.T) / 2

    def solved(self, begin, scans):
        time, x, P = begin
        n = 4 + 2 * len(scans)
        Y, start = np.zeros((n, n)), np.zeros(n)
        Y[:4, :4] = np.linalg.inv(P)
        Y[4:, 4:] = np.eye(n - 4) / self.sigma**2
        start[:4] = x
        states = self.states(time, [scan.time for scan in scans], n)
        solution = start
        for _ in range(2):  # the second time about what the first one found
            A, b = Y.copy(), Y @ start
            for T, scan in zip(states, scans, strict=True):
                if not scan.valid:
                    continue
                z, H, R = linear_at(scan, (T @ solution)[2:])
                rows = H @ T
                A += rows.T @ np.linalg.solve(R, rows)
                b += rows.T @ np.linalg.solve(R, z)
            covariance = np.linalg.inv(A)
            solution = covariance @ b
        T = states[-1] if scans else np.eye(4, n)
        P = T @ covariance @ T.T
        return T @ solution, (P + P.T) / 2

    def states(self, time, times, n):
        """At each time, the state as a linear function of the unknowns."""
        T, result = np.eye(4, n), []
        for k, after in enumerate(times):
            T = transition(after - time) @ T
            T[:, 4 + 2 * k : 6 + 2 * k] += push(after - time)
            time = after
            result.append(T)
        return result
