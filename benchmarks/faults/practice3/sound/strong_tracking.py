"""A strong tracking filter: a factor raises the predicted covariance while innovations are larger than expected."""

import numpy as np
from benchmarks.faults.parts import constant_velocity, first, linear_at, updated


class Tracker:
    forget, soft, most = 0.95, 2.2, 3.0

    def __init__(self, acceleration_sigma=3.0):
        self.sigma = acceleration_sigma

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            return (scan.time, x, P, {}), (x, P)
        time, x, P, spreads = state
        F, Q = constant_velocity(scan.time - time, self.sigma)
        x, carried = F @ x, F @ P @ F.T
        P = carried + Q
        if scan.valid:
            z, H, R = linear_at(scan, x[2:])
            y, W = z - H @ x, np.linalg.inv(R)  # traces are taken in units of the noise
            latest = y @ W @ y
            spread = latest if scan.kind not in spreads else self.mixed(spreads[scan.kind], latest)
            spreads = {**spreads, scan.kind: spread}
            surplus = spread - np.trace(W @ H @ Q @ H.T) - self.soft * len(z)
            factor = np.clip(surplus / np.trace(W @ H @ carried @ H.T), 1.0, self.most if scan.time > time else 1.0)
            x, P = updated(x, factor * carried + Q, z, H, R)
        P = (P + P.T) / 2
        return (scan.time, x, P, spreads), (x, P)

    def mixed(self, before, latest):
        return (self.forget * before + latest) / (1 + self.forget)
