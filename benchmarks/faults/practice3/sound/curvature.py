"""A filter that estimates the curvature of the path: the turn rate is the curvature times the speed.

The velocity is kept as vx and vy, so that a standing object needs no course.
"""

import numpy as np
from benchmarks.faults import parts


def carried(x, dt):
    px, py, vx, vy, curvature = x
    angle = curvature * np.hypot(vx, vy) * dt
    c, s = np.cos(angle), np.sin(angle)
    along, aside = np.sinc(angle / np.pi), angle / 2 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.array(
        [
            px + dt * (along * vx - aside * vy),
            py + dt * (aside * vx + along * vy),
            c * vx - s * vy,
            s * vx + c * vy,
            curvature,
        ]
    )


def slopes(function, x, step=1e-5):
    moves = step * np.eye(len(x))
    return np.column_stack([(function(x + d) - function(x - d)) / (2 * step) for d in moves])


class Tracker(parts.Filter):
    acceleration, bend = 2.5, 0.015  # m/s^2, and 1/m per root second

    def started(self, scan):
        x, P = parts.first(scan)
        whole = np.zeros((5, 5))
        whole[:4, :4], whole[4, 4] = P, 0.03**2
        return np.append(x, 0.0), whole

    def predicted(self, x, P, dt):
        F = slopes(lambda state: carried(state, dt), x)
        G = np.zeros((5, 3))
        G[:4, :2] = self.acceleration * parts.push(dt)
        G[4, 2] = self.bend * np.sqrt(dt)
        P = F @ P @ F.T + G @ G.T
        return carried(x, dt), (P + P.T) / 2

    def corrected(self, x, P, scan):
        z, H, R = parts.linear_at(scan, x[2:4])
        x, P = parts.updated(x, P, z, np.pad(H, ((0, 0), (0, 1))), R)
        return x, (P + P.T) / 2

    def output(self, x, P):
        return x[:4], P[:4, :4]
