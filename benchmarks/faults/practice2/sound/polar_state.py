"""A filter whose state is the range, the bearing and their rates about a fixed point beside the road."""

import numpy as np
from benchmarks.faults import parts


class Tracker:
    """Extended Kalman filter; the point lies 150 m to the right of where the first sensor stood."""

    sigma = 3.0

    def step(self, state, scan):
        if state is None:
            x, P = parts.first(scan)
            origin = scan.sensor_pose[:2] - np.array([0.0, 150.0])
        else:
            time, origin, polar, C = state
            x, J = cartesian(polar, origin)
            P = J @ C @ J.T
            x, P = parts.moved(x, P, scan.time - time, self.sigma)
            if scan.valid:
                h, H = parts.expected(x, scan)
                y = parts.difference(scan.measurement, h, scan)
                K = np.linalg.solve(H @ P @ H.T + scan.noise_covariance, H @ P).T
                x, P = parts.with_gain(x, P, K, y, H, scan.noise_covariance)
        P = (P + P.T) / 2
        polar = np.array(to_polar(x, origin))
        back = np.linalg.inv(cartesian(polar, origin)[1])
        return (scan.time, origin, polar, back @ P @ back.T), (x, P)


def to_polar(x, origin):
    dx, dy = x[:2] - origin
    r = np.hypot(dx, dy)
    return r, np.arctan2(dy, dx), (dx * x[2] + dy * x[3]) / r, (dx * x[3] - dy * x[2]) / r**2


def cartesian(polar, origin):
    """State in the fixed frame, and its derivative."""
    r, b, rate, turn = polar
    c, s = np.cos(b), np.sin(b)
    x = np.array([origin[0] + r * c, origin[1] + r * s, rate * c - r * turn * s, rate * s + r * turn * c])
    J = [
        [c, -r * s, 0, 0],
        [s, r * c, 0, 0],
        [-turn * s, -rate * s - r * turn * c, c, -r * s],
        [turn * c, rate * c - r * turn * s, s, r * c],
    ]
    return x, np.array(J, dtype=float)
