"""Iterated EKF: the innovation has a term H (x - x_i), and the covariance comes from the last linearisation."""

import numpy as np


class Tracker:
    rounds = 3

    def step(self, state, scan):
        if state is None:
            x, P = self.start(scan)
        else:
            t, x, P = state
            x, P = self.predict(x, P, scan.time - t)
            if scan.valid:
                x, P = self.iterate(x, P, scan)
        return (scan.time, x, P), (x, P)

    def start(self, scan):
        yaw = scan.sensor_pose[2] + (scan.measurement[1] if scan.kind == "radar" else 0.0)
        T = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        P = np.diag([0.0, 0.0, 20.0**2, 20.0**2])
        if scan.kind == "radar":
            r = scan.measurement[0]
            scale = np.diag([1.0, r])
            p = scan.sensor_pose[:2] + T @ [r, 0.0]
            P[:2, :2] = T @ scale @ scan.noise_covariance[:2, :2] @ scale @ T.T
        else:
            p = scan.sensor_pose[:2] + T @ scan.measurement
            P[:2, :2] = T @ scan.noise_covariance @ T.T
        return np.array([p[0], p[1], 0.0, 0.0]), P

    def predict(self, x, P, dt):
        F = np.array([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1]])
        g = np.array([dt**2 / 2, dt]) * 3.0
        Q = np.kron(np.outer(g, g), np.eye(2))
        return F @ x, F @ P @ F.T + Q

    def iterate(self, x, P, scan):
        xi = x
        for _ in range(self.rounds):
            h, H = self.measure(xi, scan)
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + scan.noise_covariance)
            y = scan.measurement - h
            if scan.kind == "radar":
                y[1] -= 2 * np.pi * np.round(y[1] / (2 * np.pi))
            xi = x + K @ (y - H @ (x - xi))
        A = np.eye(4) - K @ H
        return xi, A @ P @ A.T + K @ scan.noise_covariance @ K.T

    def measure(self, x, scan):
        yaw = scan.sensor_pose[2]
        c, s = np.cos(yaw), np.sin(yaw)
        dx, dy = x[:2] - scan.sensor_pose[:2]
        if scan.kind != "radar":
            return np.array([c * dx + s * dy, c * dy - s * dx]), np.array([[c, s, 0, 0], [-s, c, 0, 0]])
        ux, uy = x[2:] - scan.sensor_velocity
        r = np.sqrt(dx**2 + dy**2)
        rate = (dx * ux + dy * uy) / r
        H = np.array(
            [
                [dx / r, dy / r, 0, 0],
                [-dy / r**2, dx / r**2, 0, 0],
                [(ux - rate * dx / r) / r, (uy - rate * dy / r) / r, dx / r, dy / r],
            ]
        )
        return np.array([r, np.arctan2(dy, dx) - yaw, rate]), H
