"""Prediction and measurement are combined by covariance intersection: nothing is assumed of their correlation."""

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
    """The weight is that of the smallest determinant over a grid; a small part of the noise is taken as independent."""

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return (scan.time, x, P), (x, P)
        time, x, P = state
        F, Q = constant_velocity(scan.time - time, 2.0)
        x, P = F @ x, F @ P @ F.T + Q
        if scan.valid:
            z, R = position(scan)
            x, P = self.intersected(x, P, z, R)
        return (scan.time, x, P), (x, P)

    def intersected(self, x, P, z, R):
        information, H = np.linalg.inv(P), np.eye(2, 4)
        gained = H.T @ np.linalg.inv(R) @ H
        weights = np.linspace(0.5, 1.0, 51)
        sizes = [np.linalg.slogdet(w * information + (1 - w) * gained)[1] for w in weights]
        w = weights[int(np.argmax(sizes))]
        P_new = np.linalg.inv(w * information + (1 - w) * gained)
        P_new = (P_new + P_new.T) / 2
        return P_new @ (w * information @ x + (1 - w) * H.T @ np.linalg.solve(R, z)), P_new
