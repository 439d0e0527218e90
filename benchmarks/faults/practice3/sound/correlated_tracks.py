"""Track-to-track fusion: a filter for each kind of sensor, and the covariance between their errors (Bar-Shalom, Campo).

Both filters follow the same accelerations and began with the same belief of the velocity: their errors are correlated.
"""

from typing import Any, NamedTuple

import numpy as np
from benchmarks.faults.parts import constant_velocity, first, linear_at, with_gain


class Tracks(NamedTuple):
    time: float
    own: dict[str, Any]  # mean and covariance by the kind of sensor
    cross: np.ndarray  # between the error of the track that began first and that of the other


class Tracker:
    def __init__(self, acceleration_sigma=3.0):
        self.sigma = acceleration_sigma

    def step(self, state, scan):
        if state is None:
            state = Tracks(scan.time, {scan.kind: first(scan)}, np.zeros((4, 4)))
        else:
            state = self.later(state, scan.time)
            if scan.valid:
                state = self.corrected(state, scan) if scan.kind in state.own else self.joined_by(state, scan)
        return state, self.fused(state)

    def later(self, state, time):
        F, Q = constant_velocity(time - state.time, self.sigma)
        own = {kind: (F @ x, F @ P @ F.T + Q) for kind, (x, P) in state.own.items()}
        return Tracks(time, own, F @ state.cross @ F.T + Q)

    def joined_by(self, state, scan):
        """The second track: its place is wrong by its own noise, its velocity by all that the object has."""
        ((_, P),) = state.own.values()
        cross = np.zeros((4, 4))
        cross[:, 2:] = P[:, 2:]
        return state._replace(own={**state.own, scan.kind: first(scan)}, cross=cross)

    def corrected(self, state, scan):
        x, P = state.own[scan.kind]
        z, H, R = linear_at(scan, x[2:])
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        x, P = with_gain(x, P, K, z - H @ x, H, R)
        A = np.eye(4) - K @ H
        cross = A @ state.cross if scan.kind == next(iter(state.own)) else state.cross @ A.T
        return state._replace(own={**state.own, scan.kind: (x, (P + P.T) / 2)}, cross=cross)

    def fused(self, state):
        beliefs = list(state.own.values())
        if len(beliefs) == 1:
            return beliefs[0]
        (a, A), (b, B) = beliefs
        C = state.cross
        K = (A - C) @ np.linalg.pinv(A + B - C - C.T, rcond=1e-12, hermitian=True)
        P = A - K @ (A - C).T
        return a + K @ (b - a), (P + P.T) / 2
