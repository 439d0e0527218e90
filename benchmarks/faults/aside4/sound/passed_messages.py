"""A chain of variables and factors: a Gaussian message goes forward, and every factor sends its own."""

from typing import NamedTuple

import numpy as np
from benchmarks.faults.parts import difference, expected, first, transition

DENSITY = 0.6  # of the white acceleration, m^2/s^3; its noise has the inverse in closed form


class Message(NamedTuple):
    """exp(h'x - x'J x / 2), up to a factor."""

    h: np.ndarray
    J: np.ndarray

    def __mul__(self, other):
        return Message(self.h + other.h, self.J + other.J)

    def moments(self):
        P = np.linalg.inv(self.J)
        P = (P + P.T) / 2
        return P @ self.h, P


def through_motion(incoming, dt):
    """The joint of both ends of the motion factor, with the older one summed out; nothing where no time passes."""
    if dt < 1e-6:
        return incoming
    F = transition(dt)
    W = np.kron([[12 / dt**3, -6 / dt**2], [-6 / dt**2, 4 / dt]], np.eye(2) / DENSITY)
    C = -F.T @ W
    D = np.linalg.inv(incoming.J + F.T @ W @ F)
    J = W - C.T @ D @ C
    return Message(-C.T @ D @ incoming.h, (J + J.T) / 2)


def from_sensor(belief, scan):
    """The measurement's factor, linearised where the belief has its mean."""
    x, _ = belief.moments()
    h, H = expected(x, scan)
    W = np.linalg.inv(scan.noise_covariance)
    y = difference(scan.measurement, h, scan) + H @ x
    return Message(H.T @ W @ y, H.T @ W @ H)


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            J = np.linalg.inv(P)
            belief = Message(J @ x, J)
        else:
            time, belief = state
            belief = through_motion(belief, scan.time - time)
            if scan.valid:
                belief = belief * from_sensor(belief, scan)
        return (scan.time, belief), belief.moments()
