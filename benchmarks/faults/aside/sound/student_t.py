"""A filter for heavy tails: state and noise are Student's t with common degrees of freedom."""

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


NU = 5.0  # degrees of freedom, kept


class Tracker:
    """Carries the mean and the scale matrix; gives out the covariance, NU / (NU - 2) times it."""

    def step(self, state, scan):
        if state is None:
            z, R = position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return (scan.time, x, P * (NU - 2) / NU), (x, P)
        time, x, scale = state
        F, Q = constant_velocity(scan.time - time)
        x, scale = F @ x, F @ scale @ F.T + Q * (NU - 2) / NU
        if scan.valid:
            z, R = position(scan)
            S = scale[:2, :2] + R * (NU - 2) / NU
            K = np.linalg.solve(S, scale[:2]).T
            y = z - x[:2]
            distance = y @ np.linalg.solve(S, y)
            grown = (NU + distance) / (NU + 2)  # a far measurement widens, a near one narrows
            x, scale = x + K @ y, grown * (scale - K @ S @ K.T)
            scale = (scale + scale.T) / 2
        return (scan.time, x, scale), (x, scale * NU / (NU - 2))
