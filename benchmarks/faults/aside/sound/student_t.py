"""A filter for heavy tails: state and noise are Student's t with common degrees of freedom."""

import numpy as np
from benchmarks.faults.parts import constant_velocity, first, position

NU = 5.0  # degrees of freedom, kept


class Tracker:
    """Carries the mean and the scale matrix; gives out the covariance, NU / (NU - 2) times it."""

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            return (scan.time, x, P * (NU - 2) / NU), (x, P)
        time, x, scale = state
        F, Q = constant_velocity(scan.time - time)
        x, scale = F @ x, F @ scale @ F.T + Q * (NU - 2) / NU
        if scan.valid:
            z, R = position(scan)
            S = scale[:2, :2] + R * (NU - 2) / NU
            K = np.linalg.solve(S, scale[:2]).T
            y = z - x[:2]
            distance = y @ np.linalg.solve(S, y)
            grown = (NU + distance) / (NU + 2)  # a far measurement widens, a near one narrows
            x, scale = x + K @ y, grown * (scale - K @ S @ K.T)
            scale = (scale + scale.T) / 2
        return (scan.time, x, scale), (x, scale * NU / (NU - 2))
