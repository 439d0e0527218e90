"""A fading-memory filter: besides a small process noise, the predicted covariance grows by a factor of the interval."""

import numpy as np
from benchmarks.faults.parts import Filter, constant_velocity, linear, updated


class Tracker(Filter):
    """`forget` is the time constant in which old measurements lose their weight, s."""

    def __init__(self, forget=2.0):
        self.forget = forget

    def predicted(self, x, P, dt):
        F, Q = constant_velocity(dt)
        return F @ x, np.exp(dt / self.forget) * F @ P @ F.T + Q

    def corrected(self, x, P, scan):
        return updated(x, P, *linear(scan))
