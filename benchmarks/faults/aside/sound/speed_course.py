"""Speed and course inside: an extended Kalman filter, started from a linear one when the object moves."""

import numpy as np
from benchmarks.faults.parts import first, moved, position, updated, wrapped


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            return (scan.time, scan.time, "linear", x, P), (x, P)
        time, begun, form, x, P = state
        dt = scan.time - time
        if form == "linear":
            x, P = self.corrected(*moved(x, P, dt), scan)
            speed = np.hypot(*x[2:])
            if scan.time - begun < 1 or speed < 3:
                return (scan.time, begun, "linear", x, P), (x, P)
            vx, vy = x[2:]
            J = np.eye(4)
            J[2:, 2:] = [[vx / speed, vy / speed], [-vy / speed**2, vx / speed**2]]
            return (scan.time, begun, "polar", np.array([*x[:2], speed, np.arctan2(vy, vx)]), J @ P @ J.T), (x, P)
        v, c, s = x[2], np.cos(x[3]), np.sin(x[3])
        F = np.eye(4)
        F[:2, 2:] = dt * np.array([[c, -v * s], [s, v * c]])
        along, across = 3.0, 3.0 / max(abs(v), 3.0)
        G = np.array([[c * dt**2 / 2, -v * s * dt**2 / 2], [s * dt**2 / 2, v * c * dt**2 / 2], [dt, 0], [0, dt]])
        Q = G @ np.diag([along**2, across**2]) @ G.T
        x = np.array([x[0] + dt * v * c, x[1] + dt * v * s, v, x[3]])
        x, P = self.corrected(x, F @ P @ F.T + Q, scan)
        if abs(x[2]) < 1:
            mean, covariance = self.cartesian(x, P)
            return (scan.time, scan.time, "linear", mean, covariance), (mean, covariance)
        x[3] = wrapped(x[3])
        return (scan.time, begun, "polar", x, P), self.cartesian(x, P)

    def corrected(self, x, P, scan):
        if not scan.valid:
            return x, P
        z, R = position(scan)
        return updated(x, P, z, np.eye(2, 4), R)

    def cartesian(self, x, P):
        v, c, s = x[2], np.cos(x[3]), np.sin(x[3])
        J = np.eye(4)
        J[2:, 2:] = [[c, -v * s], [s, v * c]]
        return np.array([x[0], x[1], v * c, v * s]), J @ P @ J.T + 1e-6 * np.diag([0, 0, 1, 1])
