"""A fading memory filter: the predicted covariance is multiplied, and there is little process noise."""

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
    def __init__(self, memory=1.0, sigma=2.5):
        self.memory, self.sigma = memory, sigma  # s, m/s^2

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
        else:
            time, x, P = state
            dt = scan.time - time
            x, P = moved(x, P, dt, self.sigma)
            P = np.exp(dt / self.memory) * P
            if scan.valid:
                z, H, R = fixed_frame(scan, x[2:4])
                K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
                A = np.eye(4) - K @ H
                x, P = x + K @ (z - H @ x), A @ P @ A.T + K @ R @ K.T
        return (scan.time, x, P), (x, P)
