"""A square root filter: lower triangular roots by the decomposition of arrays."""

import numpy as np
from benchmarks.faults.parts import first, linear_at, push, transition


def root(A):
    """Lower triangular L with L L^T = A A^T."""
    return np.linalg.qr(A.T, mode="r").T


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            L = np.linalg.cholesky(P)
        else:
            time, x, L = state
            dt = scan.time - time
            F = transition(dt)
            x, L = F @ x, root(np.hstack([F @ L, 3.0 * push(dt)]))
            if scan.valid:
                z, H, R = linear_at(scan, x[2:])
                m = len(z)
                A = root(np.block([[np.linalg.cholesky(R), H @ L], [np.zeros((4, m)), L]]))
                x = x + A[m:, :m] @ np.linalg.solve(A[:m, :m], z - H @ x)
                L = A[m:, m:]
        return (scan.time, x, L), (x, L @ L.T)
