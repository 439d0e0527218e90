import numpy as np


class AlphaBeta:
    def __init__(self, alpha=0.5, beta=0.1, acceleration_sigma=3.0):
        self.alpha, self.beta, self.sigma = alpha, beta, acceleration_sigma

    def step(self, state, scan):
        (x, y, yaw), radar = scan.sensor_pose, scan.kind == "radar"
        r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if radar else (1.0, yaw)
        c, s = np.cos(angle), np.sin(angle)
        J = np.array([[c, -r * s], [s, r * c]])  # turns errors of the measurement into the fixed frame
        z = np.array([x, y]) + J @ ([r, 0.0] if radar else scan.measurement)
        R = J @ scan.noise_covariance[:2, :2] @ J.T
        if state is None:  # the first measurement: the velocity is anything within about 20 m/s
            mean, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return (scan.time, scan.time, mean, P), (mean, P)
        time, updated, mean, P = state
        dt, since = scan.time - time, scan.time - updated
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = self.sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        mean, P = F @ mean, F @ P @ F.T + G @ G.T
        if scan.valid:
            K = np.vstack([self.alpha * np.eye(2), (self.beta / since if since else 0.0) * np.eye(2)])
            A = np.eye(4) - np.hstack([K, np.zeros((4, 2))])
            mean, P = mean + K @ (z - mean[:2]), A @ P @ A.T + K @ R @ K.T
            updated = scan.time
        return (scan.time, updated, mean, P), (mean, P)
