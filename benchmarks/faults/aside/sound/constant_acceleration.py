"""Constant acceleration inside, six states with white jerk; position and velocity are given out."""

import numpy as np
from benchmarks.faults.parts import Filter, first


class Tracker(Filter):
    def __init__(self, jerk_density=8.0, acceleration_sigma=3.0):
        self.jerk, self.sigma = jerk_density, acceleration_sigma

    def started(self, scan):
        x, P = np.zeros(6), np.diag([0.0] * 4 + [self.sigma**2] * 2)
        x[:4], P[:4, :4] = first(scan)
        return x, P

    def predicted(self, x, P, dt):
        F = np.kron([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]], np.eye(2))
        steps = [[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]]
        return F @ x, F @ P @ F.T + self.jerk * np.kron(steps, np.eye(2))

    def output(self, x, P):
        return x[:4], P[:4, :4]
