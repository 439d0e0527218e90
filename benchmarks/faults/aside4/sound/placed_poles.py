"""An observer whose two poles are placed, equal and real, at a time constant of 0.25 s; gains follow."""

import numpy as np
from benchmarks.faults.parts import first, moved, position, with_gain

TIME_CONSTANT = 0.25


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            return (scan.time, scan.time, scan.time, x, P), (x, P)
        begun, time, used, x, P = state
        x, P = moved(x, P, scan.time - time, 6.0)
        if scan.valid:
            z, R = position(scan)
            K = self.gain(scan.time - begun, scan.time - used)
            x, P = with_gain(x, P, K, z - x[:2], np.eye(2, 4), R)
            used = scan.time
        return (begun, scan.time, used, x, P), (x, P)

    def gain(self, age, dt):
        if dt < 1e-3:
            return np.vstack([0.15 * np.eye(2), np.zeros((2, 2))])  # a second sensor at the instant
        pole = np.exp(-dt / min(TIME_CONSTANT, 0.1 + age / 3))  # faster while it is young
        return np.vstack([(1 - pole**2) * np.eye(2), (1 - pole) ** 2 / dt * np.eye(2)])
