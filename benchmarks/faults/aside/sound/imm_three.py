"""Three levels of acceleration in an interacting-multiple-model filter; the mixing depends on the interval."""

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


def linear(scan):
    """z, H and R in the fixed frame: the position, and of a radar the speed over ground along the ray."""
    radar, yaw = scan.kind == "radar", scan.sensor_pose[2]
    r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if radar else (1.0, yaw)
    c, s = np.cos(angle), np.sin(angle)
    J = np.array([[c, -r * s], [s, r * c]])
    z = scan.sensor_pose[:2] + J @ (np.array([r, 0.0]) if radar else scan.measurement)
    H, R = np.eye(2, 4), J @ scan.noise_covariance[:2, :2] @ J.T
    if radar:
        z = np.append(z, scan.measurement[2] + np.array([c, s]) @ scan.sensor_velocity)
        H = np.vstack([H, [0.0, 0.0, c, s]])
        R = np.pad(R, (0, 1))
        R[2, 2] = scan.noise_covariance[2, 2] + 0.15**2  # the ray is that of the measured azimuth
    return z, H, R


def constant_velocity(dt, sigma=3.0):
    F = np.eye(4) + dt * np.eye(4, k=2)
    G = sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
    return F, G @ G.T


SIGMAS = (1.5, 4.0, 9.0)
LEAVE = np.array([[-0.6, 0.4, 0.2], [0.8, -1.2, 0.4], [0.6, 0.9, -1.5]])  # rates from row to column, 1/s


class Tracker:
    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            mu = np.array([0.3, 0.5, 0.2])
            return (scan.time, np.tile(x, (3, 1)), np.tile(P, (3, 1, 1)), mu), (x, P)
        time, X, C, mu = state
        dt = scan.time - time
        joint = np.linalg.inv(np.eye(3) - LEAVE * max(dt, 0.0)) * mu[:, None]
        mu = joint.sum(axis=0)
        weights = joint / mu
        before = X, C
        X, C = np.empty_like(X), np.empty_like(C)
        log = np.zeros(3)
        for j, sigma in enumerate(SIGMAS):
            x, P = self.moments(*before, weights[:, j])
            F, Q = constant_velocity(dt, sigma)
            X[j], C[j] = F @ x, F @ P @ F.T + Q
            if scan.valid:
                X[j], C[j], log[j] = self.corrected(X[j], C[j], *linear(scan))
        mu = mu * np.exp(log - log.max())
        mu = mu / mu.sum()
        return (scan.time, X, C, mu), self.moments(X, C, mu)

    def moments(self, X, C, weights):
        x = weights @ X
        d = X - x
        return x, np.einsum("i,ijk->jk", weights, C + np.einsum("ij,ik->ijk", d, d))

    def corrected(self, x, P, z, H, R):
        y, S = z - H @ x, H @ P @ H.T + R
        K = np.linalg.solve(S, H @ P).T
        A = np.eye(4) - K @ H
        log = -0.5 * (y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1])
        return x + K @ y, A @ P @ A.T + K @ R @ K.T, log
