"""A gate leaves out what is far off; after three rejections in a row the velocity is freed and the gate is open."""

import numpy as np
from benchmarks.faults.parts import first, moved, position, updated


class Tracker:
    def __init__(self, gate=20.0):
        self.gate = gate

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            return (scan.time, x, P, 0), (x, P)
        time, x, P, rejected = state
        x, P = moved(x, P, scan.time - time)
        if scan.valid:
            z, R = position(scan)
            y, S = z - x[:2], P[:2, :2] + R
            if y @ np.linalg.solve(S, y) > self.gate:
                rejected += 1
                if rejected < 3:
                    return (scan.time, x, P, rejected), (x, P)
                P = P + np.diag([25.0, 25.0, 100.0, 100.0])
            x, P = updated(x, P, z, np.eye(2, 4), R)
            rejected = 0
        return (scan.time, x, P, rejected), (x, P)
