"""A Schmidt-Kalman filter: a bias of the lidar is considered in the gain and never estimated."""

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
    def __init__(self, bias_sigma=0.1):
        self.B = bias_sigma**2 * np.eye(2)

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            C = np.zeros((4, 2))  # covariance with the bias, in the fixed frame
            if scan.kind == "lidar":
                P[:2, :2] += self.B
                C[:2] = -self.B
        else:
            time, x, P, C = state
            dt = scan.time - time
            x, P = moved(x, P, dt)
            C = (np.eye(4) + dt * np.eye(4, k=2)) @ C
            if scan.valid:
                x, P, C = self.update(x, P, C, scan)
        return (scan.time, x, P, C), (x, P)

    def update(self, x, P, C, scan):
        z, H, R = fixed_frame(scan, x[2:4])
        J = np.eye(2) if scan.kind == "lidar" else np.zeros((len(z), 2))  # z = H x + J bias + noise
        S = H @ P @ H.T + H @ C @ J.T + J @ C.T @ H.T + J @ self.B @ J.T + R
        K = (P @ H.T + C @ J.T) @ np.linalg.inv(S)
        A = np.eye(4) - K @ H
        P = A @ P @ A.T - A @ C @ J.T @ K.T - K @ J @ C.T @ A.T + K @ (J @ self.B @ J.T + R) @ K.T
        return x + K @ (z - H @ x), (P + P.T) / 2, A @ C - K @ J @ self.B
