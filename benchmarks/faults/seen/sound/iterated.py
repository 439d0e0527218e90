"""An iterated extended Kalman filter: the measurement is linearised again at the updated state."""

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


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def model(x, scan):
    dx, dy = x[:2] - scan.sensor_pose[:2]
    yaw = scan.sensor_pose[2]
    if scan.kind == "lidar":
        T = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        return T @ [dx, dy], np.hstack([T, np.zeros((2, 2))])
    r = max(np.hypot(dx, dy), 1e-3)
    u, across = np.array([dx, dy]) / r, np.array([-dy, dx]) / r
    v = x[2:] - scan.sensor_velocity
    H = np.zeros((3, 4))
    H[0, :2], H[1, :2], H[2, :2], H[2, 2:] = u, across / r, (across @ v) * across / r, u
    return np.array([r, np.arctan2(dy, dx) - yaw, u @ v]), H


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
        else:
            time, x, P = state
            x, P = moved(x, P, scan.time - time)
            if scan.valid:
                x, P = self.update(x, P, scan)
        return (scan.time, x, P), (x, P)

    def update(self, x, P, scan):
        R, at = scan.noise_covariance, x
        for _ in range(3):
            h, H = model(at, scan)
            y = scan.measurement - h
            if scan.kind == "radar":
                y[1] = wrap(y[1])
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            at = x + K @ (y - H @ (x - at))
        A = np.eye(4) - K @ H
        return at, A @ P @ A.T + K @ R @ K.T
