"""The process noise is greater across the velocity than along it, as a car accelerates most where it turns."""

import numpy as np
from benchmarks.faults.parts import Filter, linear_at, push, transition, updated


class Tracker(Filter):
    along, across = 2.5, 4.0  # m/s^2

    def predicted(self, x, P, dt):
        F = transition(dt)
        speed = np.hypot(x[2], x[3])
        share = speed**2 / (speed**2 + P[2, 2] + P[3, 3])  # how far the course is known
        ahead = x[2:] / max(speed, 1e-6)
        mean = (self.along**2 + self.across**2) / 2
        turned = self.across**2 * np.eye(2) + (self.along**2 - self.across**2) * np.outer(ahead, ahead)
        spread = share * turned + (1 - share) * mean * np.eye(2)
        G = push(dt)
        return F @ x, F @ P @ F.T + G @ spread @ G.T

    def corrected(self, x, P, scan):
        x, P = updated(x, P, *linear_at(scan, x[2:]))
        return x, (P + P.T) / 2
