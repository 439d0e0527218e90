"""The filter is a generator that never ends: scans go in, estimates come out; its variables are what it knows."""

import numpy as np
from benchmarks.faults.parts import constant_velocity, difference, expected, first


def filtering():
    scan = yield
    x, P = first(scan)
    now = scan.time
    while True:
        scan = yield x, P
        F, Q = constant_velocity(scan.time - now)
        now, x, P = scan.time, F @ x, F @ P @ F.T + Q
        if scan.valid:
            h, H = expected(x, scan)
            S = H @ P @ H.T + scan.noise_covariance
            K = np.linalg.solve(S, H @ P).T
            x = x + K @ difference(scan.measurement, h, scan)
            P = P - K @ S @ K.T
            P = (P + P.T) / 2


class Tracker:
    def __init__(self):
        self.routine = filtering()
        next(self.routine)

    def step(self, state, scan):
        return True, self.routine.send(scan)
