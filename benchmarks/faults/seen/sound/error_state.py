"""An error state filter: a nominal state that is moved, and an error that is estimated and put into it."""

import numpy as np
from benchmarks.faults.parts import first, linear_at, moved, with_gain


class Tracker:
    def __init__(self):
        self.nominal = None
        self.P = None
        self.time = None

    def step(self, state, scan):
        if self.nominal is None:
            self.nominal, self.P = first(scan)
        else:
            dt = scan.time - self.time
            error, self.P = moved(np.zeros(4), self.P, dt)
            self.nominal = np.concatenate([self.nominal[:2] + dt * self.nominal[2:], self.nominal[2:]])
            if scan.valid:
                z, H, R = linear_at(scan, self.nominal[2:])
                dz = z - H @ self.nominal
                K = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + R)
                error, self.P = with_gain(error, self.P, K, dz - H @ error, H, R)
                self.nominal = self.nominal + error
        self.time = scan.time
        return None, (self.nominal.copy(), self.P.copy())
