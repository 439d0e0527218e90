"""A Kalman filter for each kind of sensor; the estimates are fused by covariance intersection."""

import numpy as np


def fixed_frame(scan, velocity=(0.0, 0.0)):
    """z, H and R: the position in the fixed frame, and of a radar the speed along the line of sight.

    An error of the azimuth turns the line of sight, along which a velocity near the predicted one is seen.
    """
    x, y, yaw = scan.sensor_pose
    if scan.kind == "lidar":
        T = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        return np.array([x, y]) + T @ scan.measurement, np.eye(2, 4), T @ scan.noise_covariance @ T.T
    r, c, s = scan.measurement[0], np.cos(yaw + scan.measurement[1]), np.sin(yaw + scan.measurement[1])
    across = s * (velocity[0] - scan.sensor_velocity[0]) - c * (velocity[1] - scan.sensor_velocity[1])
    J = np.array([[c, -r * s, 0.0], [s, r * c, 0.0], [0.0, across, 1.0]])
    H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, c, s]])
    rate = scan.measurement[2] + c * scan.sensor_velocity[0] + s * scan.sensor_velocity[1]
    return np.array([x + r * c, y + r * s, rate]), H, J @ scan.noise_covariance @ J.T


def first(scan):
    z, _, R = fixed_frame(scan)
    P = np.diag([0.0, 0.0, 400.0, 400.0])
    P[:2, :2] = R[:2, :2]
    return np.array([z[0], z[1], 0.0, 0.0]), P


def moved(x, P, dt, sigma=3.0):
    F = np.eye(4) + dt * np.eye(4, k=2)
    G = sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    return F @ x, F @ P @ F.T + G @ G.T


class Tracker:
    def step(self, state, scan):
        filters = {} if state is None else dict(state)
        for kind, (time, x, P) in filters.items():
            filters[kind] = scan.time, *moved(x, P, scan.time - time)
        if scan.valid and scan.kind not in filters:
            filters[scan.kind] = scan.time, *first(scan)
        elif scan.valid:
            _, x, P = filters[scan.kind]
            z, H, R = fixed_frame(scan, x[2:4])
            S = H @ P @ H.T + R
            K = P @ H.T @ np.linalg.inv(S)
            P = P - K @ S @ K.T
            filters[scan.kind] = scan.time, x + K @ (z - H @ x), (P + P.T) / 2
        return filters, self.fused([belief[1:] for belief in filters.values()])

    def fused(self, beliefs):
        if len(beliefs) == 1:
            return beliefs[0]
        (a, A), (b, B) = beliefs
        Ai, Bi = (np.linalg.inv(C + 1e-8 * np.eye(4)) for C in (A, B))
        shares = np.linspace(0.0, 1.0, 21)
        w = min(shares, key=lambda w: np.linalg.det(np.linalg.inv(w * Ai + (1 - w) * Bi)))
        P = np.linalg.inv(w * Ai + (1 - w) * Bi)
        return P @ (w * Ai @ a + (1 - w) * Bi @ b), (P + P.T) / 2
