"""A Schmidt-Kalman filter: a bias of each sensor is considered, and never estimated."""

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


BIAS = 0.1**2  # m², in the fixed frame, of each sensor


class Tracker:
    """State px, py, vx, vy; beside its covariance those with the biases of radar and lidar."""

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            C = {kind: np.zeros((4, 2)) for kind in ("radar", "lidar")}
            C[scan.kind] = BIAS * np.eye(4, 2)
            P[:2, :2] += BIAS * np.eye(2)
            return (scan.time, x, P, C), (x, P)
        time, x, P, C = state
        F, Q = constant_velocity(scan.time - time)
        x, P, C = F @ x, F @ P @ F.T + Q, {kind: F @ cross for kind, cross in C.items()}
        if scan.valid:
            z, R = position(scan)
            H, B = np.eye(2, 4), C[scan.kind]
            PHt = P @ H.T + B
            S = H @ P @ H.T + H @ B + (H @ B).T + BIAS * np.eye(2) + R
            K = np.linalg.solve(S, PHt.T).T
            x = x + K @ (z - H @ x)
            P = P - K @ PHt.T - PHt @ K.T + K @ S @ K.T
            P = (P + P.T) / 2
            own = {kind: BIAS * np.eye(2) if kind == scan.kind else np.zeros((2, 2)) for kind in C}
            C = {kind: cross - K @ (H @ cross + own[kind]) for kind, cross in C.items()}
        return (scan.time, x, P, C), (x, P)
