"""Speed and course inside: an extended Kalman filter, started from a linear one when the object moves."""

import numpy as np


def position(scan):
    """The position in the fixed frame and its covariance."""
    x, y, yaw = scan.sensor_pose
    radar = scan.kind == "radar"
    r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if radar else (1.0, yaw)
    c, s = np.cos(angle), np.sin(angle)
    J = np.array([[c, -r * s], [s, r * c]])
    local = np.array([r, 0.0]) if radar else scan.measurement
    return np.array([x, y]) + J @ local, J @ scan.noise_covariance[:2, :2] @ J.T


def constant_velocity(dt, sigma=3.0):
    F = np.eye(4) + dt * np.eye(4, k=2)
    G = sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    return F, G @ G.T


class Tracker:
    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return (scan.time, scan.time, "linear", x, P), (x, P)
        time, begun, form, x, P = state
        dt = scan.time - time
        if form == "linear":
            F, Q = constant_velocity(dt)
            x, P = self.corrected(F @ x, F @ P @ F.T + Q, scan)
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
        x[3] = (x[3] + np.pi) % (2 * np.pi) - np.pi
        return (scan.time, begun, "polar", x, P), self.cartesian(x, P)

    def corrected(self, x, P, scan):
        if not scan.valid:
            return x, P
        z, R = position(scan)
        K = np.linalg.solve(P[:2, :2] + R, P[:2]).T
        A = np.eye(4) - K @ np.eye(2, 4)
        return x + K @ (z - x[:2]), A @ P @ A.T + K @ R @ K.T

    def cartesian(self, x, P):
        v, c, s = x[2], np.cos(x[3]), np.sin(x[3])
        J = np.eye(4)
        J[2:, 2:] = [[c, -v * s], [s, v * c]]
        return np.array([x[0], x[1], v * c, v * s]), J @ P @ J.T + 1e-6 * np.diag([0, 0, 1, 1])
