"""Constant acceleration within, of which position and velocity are returned."""

import numpy as np
from benchmarks.faults.parts import Filter, first, linear_at, with_gain


class Tracker(Filter):
    def __init__(self, jerk=4.0):
        self.jerk = jerk

    def started(self, scan):
        x, P = np.zeros(6), np.diag([0.0] * 4 + [9.0] * 2)
        x[:4], P[:4, :4] = first(scan)
        return x, P

    def predicted(self, x, P, dt):
        F = np.eye(6) + dt * np.eye(6, k=2) + dt**2 / 2 * np.eye(6, k=4)
        G = self.jerk * np.vstack([dt**3 / 6 * np.eye(2), dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        return F @ x, F @ P @ F.T + G @ G.T

    def corrected(self, x, P, scan):
        z, H, R = linear_at(scan, x[2:4])
        H = np.hstack([H, np.zeros((len(z), 2))])
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        return with_gain(x, P, K, z - H @ x, H, R)

    def output(self, x, P):
        return x[:4].copy(), P[:4, :4].copy()
