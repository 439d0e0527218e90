"""An H-infinity filter: the bound theta on the worst error makes it trust its model less than a Kalman filter."""

import numpy as np
from benchmarks.faults.parts import Filter, position


class Tracker(Filter):
    def __init__(self, theta=0.02):
        self.theta = theta

    def corrected(self, x, P, scan):
        z, R = position(scan)
        H, information = np.eye(2, 4), np.linalg.inv(P)
        weight = np.diag([1.0, 1.0, 0.1, 0.1])
        gained = information + H.T @ np.linalg.solve(R, H)
        theta = self.theta
        while np.linalg.eigvalsh(gained - theta * weight)[0] <= 0.2 * np.linalg.eigvalsh(gained)[0]:
            theta /= 2  # the bound cannot be met yet
        P = np.linalg.inv(gained - theta * weight)
        P = (P + P.T) / 2
        return x + P @ H.T @ np.linalg.solve(R, z - x[:2]), P
