"""A cubature Kalman filter: eight points of equal weight, drawn before the prediction and again before the update."""

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


def expected(x, scan):
    """What the sensor would measure of the state, and its derivative."""
    dx, dy = x[:2] - scan.sensor_pose[:2]
    yaw = scan.sensor_pose[2]
    if scan.kind != "radar":
        turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        return turn @ np.array([dx, dy]), np.hstack([turn, np.zeros((2, 2))])
    ux, uy = x[2:4] - scan.sensor_velocity
    r = np.hypot(dx, dy)
    swing = (ux * dy - uy * dx) / r**3
    H = [[dx / r, dy / r, 0, 0], [-dy / r**2, dx / r**2, 0, 0], [dy * swing, -dx * swing, dx / r, dy / r]]
    return np.array([r, np.arctan2(dy, dx) - yaw, (dx * ux + dy * uy) / r]), np.array(H)


def difference(z, other, scan):
    gap = z - other
    if scan.kind == "radar":
        gap[1] = (gap[1] + np.pi) % (2 * np.pi) - np.pi
    return gap


def constant_velocity(dt, sigma=3.0):
    F = np.eye(4) + dt * np.eye(4, k=2)
    G = sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    return F, G @ G.T


def points(x, P):
    root = 2.0 * np.linalg.cholesky(P)  # the root of n = 4
    return x[:, None] + np.hstack([root, -root])


class Tracker:
    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return (scan.time, x, P), (x, P)
        time, x, P = state
        dt = scan.time - time
        F, Q = constant_velocity(dt)
        X = F @ points(x, P)
        x = X.mean(axis=1)
        P = (X - x[:, None]) @ (X - x[:, None]).T / 8 + Q
        if scan.valid:
            x, P = self.corrected(x, P, scan)
        return (scan.time, x, P), (x, P)

    def corrected(self, x, P, scan):
        X = points(x, P)
        centre = expected(x, scan)[0]
        offsets = np.array([difference(expected(column, scan)[0], centre, scan) for column in X.T]).T
        mean = offsets.mean(axis=1)
        dz, dx = offsets - mean[:, None], X - x[:, None]
        S = dz @ dz.T / 8 + scan.noise_covariance
        K = np.linalg.solve(S, dz @ dx.T / 8).T
        P = P - K @ S @ K.T
        return x + K @ (difference(scan.measurement, centre, scan) - mean), (P + P.T) / 2
