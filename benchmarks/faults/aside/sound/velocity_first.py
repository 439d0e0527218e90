"""The state is vy, py, vx, px, and positions are held relative to the place of the first measurement."""

import numpy as np
from benchmarks.faults.parts import position, updated

OUT = [3, 1, 2, 0]  # px, py, vx, vy


class Tracker:
    def step(self, state, scan):
        if state is None:
            origin, R = position(scan)
            x, P = np.zeros(4), np.diag([400.0, 0.0, 400.0, 0.0])
            P[np.ix_([3, 1], [3, 1])] = R
        else:
            time, origin, x, P = state
            dt = scan.time - time
            F = np.array([[1, 0, 0, 0], [dt, 1, 0, 0], [0, 0, 1, 0], [0, 0, dt, 1.0]])
            G = 3.0 * np.array([[dt, 0], [dt**2 / 2, 0], [0, dt], [0, dt**2 / 2]])
            x, P = F @ x, F @ P @ F.T + G @ G.T
            if scan.valid:
                z, R = position(scan)
                x, P = updated(x, P, z - origin, np.array([[0, 0, 0, 1.0], [0, 1.0, 0, 0]]), R)
        mean = x[OUT]
        mean[:2] += origin
        return (scan.time, origin, x, P), (mean, P[np.ix_(OUT, OUT)])
