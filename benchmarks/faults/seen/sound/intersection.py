"""A Kalman filter for each kind of sensor; the estimates are fused by covariance intersection."""

import numpy as np
from benchmarks.faults.parts import first, linear_at, moved


class Tracker:
    def step(self, state, scan):
        filters = {} if state is None else dict(state)
        for kind, (time, x, P) in filters.items():
            filters[kind] = scan.time, *moved(x, P, scan.time - time)
        if scan.valid and scan.kind not in filters:
            filters[scan.kind] = scan.time, *first(scan)
        elif scan.valid:
            _, x, P = filters[scan.kind]
            z, H, R = linear_at(scan, x[2:])
            S = H @ P @ H.T + R
            K = P @ H.T @ np.linalg.inv(S)
            P = P - K @ S @ K.T
            filters[scan.kind] = scan.time, x + K @ (z - H @ x), (P + P.T) / 2
        return filters, self.fused([belief[1:] for belief in filters.values()])

    def fused(self, beliefs):
        if len(beliefs) == 1:
            return beliefs[0]
        (a, A), (b, B) = beliefs
        Ai, Bi = (np.linalg.inv(C + 1e-8 * np.eye(4)) for C in (A, B))
        shares = np.linspace(0.0, 1.0, 21)
        w = min(shares, key=lambda w: np.linalg.det(np.linalg.inv(w * Ai + (1 - w) * Bi)))
        P = np.linalg.inv(w * Ai + (1 - w) * Bi)
        return P @ (w * Ai @ a + (1 - w) * Bi @ b), (P + P.T) / 2
