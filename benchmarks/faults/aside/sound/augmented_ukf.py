"""An unscented filter whose points carry the acceleration too: no noise is added, and the moved points are updated."""

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


class Tracker:
    """alpha .5, beta 2, kappa 0 over four states and two accelerations."""

    def __init__(self, acceleration_sigma=3.0):
        self.sigma = acceleration_sigma
        n, alpha, beta = 6, 0.5, 2.0
        spread = alpha**2 * n
        self.spread = spread
        self.mean_weights = np.full(2 * n + 1, 0.5 / spread)
        self.mean_weights[0] = 1 - n / spread
        self.weights = self.mean_weights.copy()
        self.weights[0] += 1 - alpha**2 + beta

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return (scan.time, x, P), (x, P)
        time, x, P = state
        dt = scan.time - time
        augmented = np.zeros((6, 6))
        augmented[:4, :4], augmented[4:, 4:] = P, self.sigma**2 * np.eye(2)
        root = np.linalg.cholesky(self.spread * augmented)
        centre = np.concatenate([x, np.zeros(2)])[:, None]
        X = np.hstack([centre, centre + root, centre - root])
        moved = np.vstack([X[:2] + dt * X[2:4] + dt**2 / 2 * X[4:], X[2:4] + dt * X[4:]])
        x = moved @ self.mean_weights
        dx = moved - x[:, None]
        P = (self.weights * dx) @ dx.T
        if scan.valid:
            base = expected(x, scan)[0]
            offsets = np.array([difference(expected(column, scan)[0], base, scan) for column in moved.T]).T
            mean = offsets @ self.mean_weights
            dz = offsets - mean[:, None]
            S = (self.weights * dz) @ dz.T + scan.noise_covariance
            K = np.linalg.solve(S, (self.weights * dz) @ dx.T).T
            x, P = x + K @ (difference(scan.measurement, base, scan) - mean), P - K @ S @ K.T
        P = (P + P.T) / 2 + 1e-9 * np.eye(4)
        return (scan.time, x, P), (x, P)
