"""A filter in logarithmic polar coordinates about the sensor: ln r, bearing, and the rates of both.

In these, motion without acceleration about a point that stands has a closed form, and range and azimuth are linear.
The point is where the sensor was last; a scan from another place changes the point first.
"""

import numpy as np
from benchmarks.faults import parts


def to_polar(x):
    r2 = x[0] ** 2 + x[1] ** 2
    return np.array(
        [np.log(r2) / 2, np.arctan2(x[1], x[0]), (x[0] * x[2] + x[1] * x[3]) / r2, (x[0] * x[3] - x[1] * x[2]) / r2]
    )


def to_cartesian(p):
    r, c, s = np.exp(p[0]), np.cos(p[1]), np.sin(p[1])
    return r * np.array([c, s, p[2] * c - p[3] * s, p[2] * s + p[3] * c])


def jacobian(p):
    """Of the Cartesian state."""
    r, c, s = np.exp(p[0]), np.cos(p[1]), np.sin(p[1])
    u, w = p[2] * c - p[3] * s, p[2] * s + p[3] * c
    return r * np.array([[c, -s, 0, 0], [s, c, 0, 0], [u, -w, c, -s], [w, u, s, c]])


def ahead(p, dt):
    """After an interval, and the derivative: the complex number 1 + dt (p2 + i p3) stretches and turns the ray."""
    rate = p[2] + 1j * p[3]
    turn = 1 + dt * rate
    after = rate / turn
    lean = dt / turn  # derivative of ln turn by the rate
    bend = 1 / turn**2  # of the rate after
    F = np.eye(4)
    F[:2, 2:] = [[lean.real, -lean.imag], [lean.imag, lean.real]]
    F[2:, 2:] = [[bend.real, -bend.imag], [bend.imag, bend.real]]
    return np.array([p[0] + np.log(abs(turn)), p[1] + np.angle(turn), after.real, after.imag]), F


class Tracker:
    sigma = 3.0

    def step(self, state, scan):
        here = np.array(scan.sensor_pose[:2])
        if state is None:
            x, C = parts.first(scan)
            p = to_polar(x - [*here, 0.0, 0.0])
            back = np.linalg.inv(jacobian(p))
            P = back @ C @ back.T
        else:
            time, place, p, P = state
            p, P = self.moved_point(p, P, here - place)
            dt = scan.time - time
            p, F = ahead(p, dt)
            G = np.linalg.solve(jacobian(p), self.sigma * parts.push(dt))
            P = F @ P @ F.T + G @ G.T
            if scan.valid:
                p, P = self.corrected(p, P, scan)
        P = (P + P.T) / 2
        J = jacobian(p)
        C = J @ P @ J.T
        x = to_cartesian(p)
        x[:2] += here
        return (scan.time, here, p, P), (x, (C + C.T) / 2)

    def moved_point(self, p, P, shift):
        if not shift.any():
            return p, P
        J = jacobian(p)
        p = to_polar(to_cartesian(p) - [*shift, 0.0, 0.0])
        T = np.linalg.solve(jacobian(p), J)
        return p, T @ P @ T.T

    def corrected(self, p, P, scan):
        """Range and bearing, also of a lidar; then, linearised at the corrected place, the range rate."""
        x, y = scan.measurement[:2]
        R = scan.noise_covariance
        if scan.kind == "radar":
            z, scale = np.array([np.log(x), scan.sensor_pose[2] + y]), np.diag([1 / x, 1.0])
        else:
            r2 = x**2 + y**2
            z = np.array([np.log(r2) / 2, scan.sensor_pose[2] + np.arctan2(y, x)])
            scale = np.array([[x, y], [-y, x]]) / r2
        gap = z - p[:2]
        gap[1] = parts.wrapped(gap[1])
        p, P = parts.updated(p, P, p[:2] + gap, np.eye(2, 4), scale @ R[:2, :2] @ scale.T)
        if scan.kind == "radar":
            r, c, s = np.exp(p[0]), np.cos(p[1]), np.sin(p[1])
            vx, vy = scan.sensor_velocity
            predicted = r * p[2] - c * vx - s * vy
            H = np.array([[r * p[2], s * vx - c * vy, r, 0.0]])
            p, P = parts.updated(p, P, H @ p + scan.measurement[2] - predicted, H, R[2:, 2:])
        return p, P
