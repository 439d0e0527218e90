"""An information filter: the state is the inverse covariance and the information vector."""

import numpy as np
from benchmarks.faults.parts import first, linear_at, moved


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            Y = np.linalg.inv(P)
            y = Y @ x
        else:
            time, y, Y = state
            P = np.linalg.inv(Y)
            x, P = moved(P @ y, P, scan.time - time)
            Y = np.linalg.inv(P)
            y = Y @ x
            if scan.valid:
                z, H, R = linear_at(scan, x[2:])
                W = np.linalg.inv(R)
                y, Y = y + H.T @ W @ z, Y + H.T @ W @ H
        P = np.linalg.inv(Y)
        P = (P + P.T) / 2
        return (scan.time, y, (Y + Y.T) / 2), (P @ y, P)
