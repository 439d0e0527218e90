"""Singer's model: the acceleration is correlated over a second."""

import numpy as np
from benchmarks.faults.parts import Filter, first, position, updated

PLACES = [0, 3]  # px and py; the state is px, vx, ax, py, vy, ay
OUT = [0, 3, 1, 4]  # px, py, vx, vy


class Tracker(Filter):
    def __init__(self, time_constant=1.0, acceleration_sigma=2.5):
        self.tau, self.sigma = time_constant, acceleration_sigma

    def started(self, scan):
        x, P = np.zeros(6), np.diag([0.0, 0.0, self.sigma**2] * 2)
        x[OUT], P[np.ix_(OUT, OUT)] = first(scan)
        return x, P

    def predicted(self, x, P, dt):
        """The noise by Gauss-Legendre quadrature over the interval."""
        places, weights = np.polynomial.legendre.leggauss(5)
        Q = np.zeros((3, 3))
        for place, weight in zip(places, weights, strict=True):
            push = self.along_axis(dt * (1 + place) / 2)[:, 2]
            Q += weight * dt / 2 * 2 * self.sigma**2 / self.tau * np.outer(push, push)
        F = np.kron(np.eye(2), self.along_axis(dt))
        return F @ x, F @ P @ F.T + np.kron(np.eye(2), Q)

    def along_axis(self, dt):
        a, e = 1 / self.tau, np.exp(-dt / self.tau)
        return np.array([[1, dt, (a * dt - 1 + e) / a**2], [0, 1, (1 - e) / a], [0, 0, e]])

    def corrected(self, x, P, scan):
        z, R = position(scan)
        return updated(x, P, z, np.eye(6)[PLACES], R)

    def output(self, x, P):
        return x[OUT], P[np.ix_(OUT, OUT)]
