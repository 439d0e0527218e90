"""Moving horizon: the accelerations of the last ten scans are solved for, and none may be beyond 8 m/s^2."""

import numpy as np
from benchmarks.faults.parts import first, linear_at, push, transition, updated

LONG, LIMIT, SIGMA = 10, 8.0, 3.0


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            return (scan.time, x, P, (), (x, P)), (x, P)
        time, x0, P0, window, latest = state
        dt = scan.time - time
        row = None
        if scan.valid:
            z, H, R = linear_at(scan, (transition(dt) @ latest[0])[2:])
            row = z, H, R + 1e-6 * np.eye(len(z))
        window = (*window, (dt, row))
        if len(window) > LONG:
            (gone, row), window = window[0], window[1:]
            x0, P0 = self.forgotten(x0, P0, gone, row)
        latest = self.solved(x0, P0, window)
        return (scan.time, x0, P0, window, latest), latest

    def forgotten(self, x, P, dt, row):
        """The arrival cost moves on by a scan."""
        F, G = transition(dt), SIGMA * push(dt)
        x, P = F @ x, F @ P @ F.T + G @ G.T
        return (x, P) if row is None else updated(x, P, *row)

    def solved(self, x0, P0, window):
        """Unknown are the start and the accelerations; those at the limit are fixed there, the rest solved again."""
        n = 4 + 2 * len(window)
        M = np.eye(4, n)  # the state now, of the unknowns
        W = np.linalg.inv(np.linalg.cholesky(P0))
        rows, values = [W @ M], [W @ x0]
        for k, (dt, row) in enumerate(window):
            u = np.eye(2, n, k=4 + 2 * k)
            M = transition(dt) @ M + push(dt) @ u
            rows.append(u / SIGMA)
            values.append(np.zeros(2))
            if row is not None:
                z, H, R = row
                W = np.linalg.inv(np.linalg.cholesky(R))
                rows.append(W @ H @ M)
                values.append(W @ z)
        A, b = np.vstack(rows), np.concatenate(values)
        normal = A.T @ A
        unit = 1 / np.sqrt(np.diag(normal))
        V = np.linalg.inv(normal * np.outer(unit, unit)) * np.outer(unit, unit)
        theta = V @ A.T @ b
        fixed = np.flatnonzero(np.abs(theta[4:]) > LIMIT) + 4
        if len(fixed):
            held = np.clip(theta[fixed], -LIMIT, LIMIT)
            theta = theta + V[:, fixed] @ np.linalg.solve(V[np.ix_(fixed, fixed)], held - theta[fixed])
        P = M @ V @ M.T
        return M @ theta, (P + P.T) / 2 + 1e-9 * np.eye(4)
