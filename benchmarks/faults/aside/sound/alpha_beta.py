"""A critically damped alpha-beta filter: gains of the interval alone. Its covariance is that of its own errors."""

import numpy as np
from benchmarks.faults.parts import first, moved, position, with_gain


class Tracker:
    """Discount theta per second; a first estimate of the velocity needs two measurements."""

    def __init__(self, theta=1e-4, acceleration_sigma=4.0):
        self.theta, self.sigma = theta, acceleration_sigma

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            return (scan.time, scan.time, 1, x, P), (x, P)
        time, updated, count, x, P = state
        x, P = moved(x, P, scan.time - time, self.sigma)
        if scan.valid:
            z, R = position(scan)
            since = max(scan.time - updated, 0.0)
            keep = self.theta ** (since / 2) if since > 0 else 1.0
            alpha, beta = 1 - keep**2, (1 - keep) ** 2
            count += 1
            grown = 2 * (2 * count - 1) / (count * (count + 1))  # of the expanding memory, until it is smaller
            alpha = max(alpha, grown) if count < 8 else max(alpha, 0.05)
            beta = max(beta, 6 / (count * (count + 1))) if count < 8 else beta
            K = np.vstack([alpha * np.eye(2), (beta / since if since > 0 else 0.0) * np.eye(2)])
            x, P = with_gain(x, P, K, z - x[:2], np.eye(2, 4), R)
            updated = scan.time
        return (scan.time, updated, count, x, P), (x, P)
