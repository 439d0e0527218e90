"""An iterated extended Kalman filter: the measurement is linearised again at the updated state."""

import numpy as np
from benchmarks.faults.parts import Filter, difference


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


class Tracker(Filter):
    def corrected(self, x, P, scan):
        R, at = scan.noise_covariance, x
        for _ in range(3):
            h, H = model(at, scan)
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            at = x + K @ (difference(scan.measurement, h, scan) - H @ (x - at))
        A = np.eye(4) - K @ H
        return at, A @ P @ A.T + K @ R @ K.T
