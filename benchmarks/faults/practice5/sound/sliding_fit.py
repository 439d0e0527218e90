"""A parabola through the places of the last 0.8 s, by least squares; there is no recursion and no prior."""

import numpy as np
from benchmarks.faults.parts import first, linear_at, moved, updated

SPAN, FEWEST, JERK = 0.8, 6, 6.0  # s, places, m/s^3


class Tracker:
    """Kept are the measurements, each with the velocity that it was taken in with."""

    def step(self, state, scan):
        past, last = ([], None) if state is None else state
        velocity = np.zeros(2) if last is None else last[1][2:]
        if scan.valid:
            past = [*past, (scan.time, *linear_at(scan, velocity))]
        recent = [one for one in past if scan.time - one[0] <= SPAN]
        if len(recent) >= FEWEST and recent[-1][0] - recent[0][0] > SPAN / 2:
            x, P = self.fitted(recent, scan.time)
        elif last is None:
            x, P = first(scan)
        else:
            time, x, P = last
            x, P = moved(x, P, scan.time - time)
            if scan.valid:
                x, P = updated(x, P, *past[-1][1:])
        return (recent, (scan.time, x, P)), (x, (P + P.T) / 2)

    def fitted(self, recent, now):
        """Place, velocity and acceleration now; what a parabola leaves out counts as noise."""
        Y, y = np.zeros((6, 6)), np.zeros(6)
        for time, z, H, R in recent:
            t = time - now
            A = np.hstack([H @ (np.eye(4) + t * np.eye(4, k=2)), H @ np.vstack([t**2 / 2 * np.eye(2), t * np.eye(2)])])
            left = H @ np.vstack([JERK * t**3 / 6 * np.eye(2), JERK * t**2 / 2 * np.eye(2)])
            W = np.linalg.inv(R + left @ left.T)
            Y += A.T @ W @ A
            y += A.T @ W @ z
        P = np.linalg.inv(Y + np.diag([0, 0, 0, 0, 1.0, 1.0]) / 6.0**2)
        return (P @ y)[:4], 1.6 * P[:4, :4]
