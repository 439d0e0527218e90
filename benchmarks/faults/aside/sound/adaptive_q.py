"""The process noise follows the innovations: a smoothed NIS scales it between a quiet and an agile level."""

import numpy as np
from benchmarks.faults.parts import first, moved, position, updated


class Tracker:
    def __init__(self, quiet=2.5, agile=9.0, memory=0.8):
        self.quiet, self.agile, self.memory = quiet, agile, memory

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            return (scan.time, x, P, 3.0), (x, P)
        time, x, P, sigma = state
        x, P = moved(x, P, scan.time - time, sigma)
        if scan.valid:
            z, R = position(scan)
            S, y = P[:2, :2] + R, z - x[:2]
            share = (y @ np.linalg.solve(S, y) / 2) ** 0.5
            wanted = np.clip(sigma * (0.5 + 0.5 * share), self.quiet, self.agile)
            sigma = self.memory * sigma + (1 - self.memory) * wanted
            x, P = updated(x, P, z, np.eye(2, 4), R)
        return (scan.time, x, P, sigma), (x, P)
