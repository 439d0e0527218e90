"""The state is vy, py, vx, px, and positions are held relative to the place of the first measurement."""

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


OUT = [3, 1, 2, 0]  # px, py, vx, vy


class Tracker:
    def step(self, state, scan):
        if state is None:
            origin, R = position(scan)
            x, P = np.zeros(4), np.diag([400.0, 0.0, 400.0, 0.0])
            P[np.ix_([3, 1], [3, 1])] = R
        else:
            time, origin, x, P = state
            dt = scan.time - time
            F = np.array([[1, 0, 0, 0], [dt, 1, 0, 0], [0, 0, 1, 0], [0, 0, dt, 1.0]])
            G = 3.0 * np.array([[dt, 0], [dt**2 / 2, 0], [0, dt], [0, dt**2 / 2]])
            x, P = F @ x, F @ P @ F.T + G @ G.T
            if scan.valid:
                z, R = position(scan)
                H = np.array([[0, 0, 0, 1.0], [0, 1.0, 0, 0]])
                K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
                A = np.eye(4) - K @ H
                x, P = x + K @ (z - origin - H @ x), A @ P @ A.T + K @ R @ K.T
        mean = x[OUT]
        mean[:2] += origin
        return (scan.time, origin, x, P), (mean, P[np.ix_(OUT, OUT)])
