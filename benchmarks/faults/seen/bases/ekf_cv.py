"""An extended Kalman filter with constant velocity for radar and lidar, in functions."""

import numpy as np


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def rotation(yaw):
    """From the sensor's frame into the fixed one."""
    return np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])


def start(scan):
    """Position of the first measurement, with any velocity of a road vehicle."""
    x, y, yaw = scan.sensor_pose
    if scan.kind == "radar":
        r, azimuth = scan.measurement[0], scan.measurement[1]
        T = rotation(yaw + azimuth)
        local, R = np.array([r, 0.0]), scan.noise_covariance[:2, :2] * np.outer([1.0, r], [1.0, r])
    else:
        T = rotation(yaw)
        local, R = scan.measurement, scan.noise_covariance
    mean = np.concatenate([[x, y] + T @ local, np.zeros(2)])
    P = np.zeros((4, 4))
    P[:2, :2] = T @ R @ T.T
    P[2, 2] = P[3, 3] = 20.0**2
    return mean, P


def predict(mean, P, dt, sigma):
    F = np.array([[1.0, 0.0, dt, 0.0], [0.0, 1.0, 0.0, dt], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    G = np.array([[dt**2 / 2, 0.0], [0.0, dt**2 / 2], [dt, 0.0], [0.0, dt]])
    Q = sigma**2 * G @ G.T
    return F @ mean, F @ P @ F.T + Q


def radar_model(mean, pose, velocity):
    """Range, azimuth and range rate of the state, and their derivatives."""
    dx, dy = mean[:2] - pose[:2]
    vx, vy = mean[2:] - velocity
    r = max(np.hypot(dx, dy), 1e-3)
    rate = (dx * vx + dy * vy) / r
    h = np.array([r, np.arctan2(dy, dx) - pose[2], rate])
    H = np.array(
        [
            [dx / r, dy / r, 0.0, 0.0],
            [-dy / r**2, dx / r**2, 0.0, 0.0],
            [vx / r - rate * dx / r**2, vy / r - rate * dy / r**2, dx / r, dy / r],
        ]
    )
    return h, H


def lidar_model(mean, pose):
    T = rotation(pose[2]).T
    return T @ (mean[:2] - pose[:2]), np.hstack([T, np.zeros((2, 2))])


def correct(mean, P, y, H, R):
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    mean = mean + K @ y
    I_KH = np.eye(4) - K @ H
    P = I_KH @ P @ I_KH.T + K @ R @ K.T
    return mean, P


class Tracker:
    def __init__(self, acceleration_sigma=3.0):
        self.sigma = acceleration_sigma

    def step(self, state, scan):
        if state is None:
            mean, P = start(scan)
            return (scan.time, mean, P), (mean, P)
        time, mean, P = state
        dt = scan.time - time
        mean, P = predict(mean, P, dt, self.sigma)
        if scan.valid and scan.kind == "radar":
            h, H = radar_model(mean, scan.sensor_pose, scan.sensor_velocity)
            y = scan.measurement - h
            y[1] = wrap(y[1])
            mean, P = correct(mean, P, y, H, scan.noise_covariance)
        elif scan.valid:
            h, H = lidar_model(mean, scan.sensor_pose)
            mean, P = correct(mean, P, scan.measurement - h, H, scan.noise_covariance)
        return (scan.time, mean, P), (mean, P)
