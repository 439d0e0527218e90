"""An unscented Kalman filter with additive noise. Sigma points are drawn again after the prediction."""

import numpy as np


def sigma_points(mean, covariance, kappa):
    n = len(mean)
    root = np.linalg.cholesky((n + kappa) * covariance)
    points = np.column_stack([mean, mean[:, None] + root, mean[:, None] - root])
    weights = np.full(2 * n + 1, 0.5 / (n + kappa))
    weights[0] = kappa / (n + kappa)
    return points, weights


class Tracker:
    """State px, py, vx, vy."""

    def __init__(self, acceleration_sigma=3.0, kappa=1.0):
        self.acceleration_sigma = acceleration_sigma
        self.kappa = kappa

    def step(self, state, scan):
        if state is None:
            x, P = self.first(scan)
            return (scan.time, x, P), (x, P)
        time, x, P = state
        dt = scan.time - time
        Q = self.process_noise(dt)
        x, P, points, weights = self.predict(x, P, Q, dt)
        if scan.valid:
            points, weights = sigma_points(x, P, self.kappa)
            x, P = self.correct(x, P, points, weights, scan)
        return (scan.time, x, P), (x, P)

    def first(self, scan):
        px, py, yaw = scan.sensor_pose
        if scan.kind == "radar":
            r, angle = scan.measurement[0], yaw + scan.measurement[1]
        else:
            r, angle = 1.0, yaw
        c, s = np.cos(angle), np.sin(angle)
        J = np.array([[c, -r * s], [s, r * c]])
        local = np.array([r, 0.0]) if scan.kind == "radar" else scan.measurement
        P = np.diag([0.0, 0.0, 400.0, 400.0])
        P[:2, :2] = J @ scan.noise_covariance[:2, :2] @ J.T
        return np.array([*(np.array([px, py]) + J @ local), 0.0, 0.0]), P

    def process_noise(self, dt):
        G = np.array([[dt**2 / 2, 0], [0, dt**2 / 2], [dt, 0], [0, dt]])
        return self.acceleration_sigma**2 * G @ G.T + 1e-9 * np.eye(4)

    def predict(self, mean, covariance, Q, dt):
        points, weights = sigma_points(mean, covariance, self.kappa)
        moved = points + dt * np.vstack([points[2:], np.zeros_like(points[2:])])
        mean_pred = moved @ weights
        diff = moved - mean_pred[:, None]
        return mean_pred, (diff * weights) @ diff.T + Q, moved, weights

    def correct(self, x, P, points, weights, scan):
        Z = self.measured(points, scan)
        z_mean = self.mean_measurement(Z, weights, scan.kind)
        dz = self.residual(Z - z_mean[:, None], scan.kind)
        dx = points - x[:, None]
        S = (dz * weights) @ dz.T + scan.noise_covariance
        K = np.linalg.solve(S, ((dx * weights) @ dz.T).T).T
        innovation = self.residual((scan.measurement - z_mean)[:, None], scan.kind)[:, 0]
        P = P - K @ S @ K.T
        return x + K @ innovation, (P + P.T) / 2

    def measured(self, points, scan):
        dx, dy = points[:2] - scan.sensor_pose[:2, None]
        yaw = scan.sensor_pose[2]
        if scan.kind == "lidar":
            return np.array([np.cos(yaw) * dx + np.sin(yaw) * dy, np.cos(yaw) * dy - np.sin(yaw) * dx])
        ux, uy = points[2:] - scan.sensor_velocity[:, None]
        r = np.hypot(dx, dy)
        azimuth = np.arctan2(dy, dx) - yaw
        azimuth = (azimuth + np.pi) % (2 * np.pi) - np.pi
        return np.array([r, azimuth, (dx * ux + dy * uy) / r])

    def mean_measurement(self, Z, weights, kind):
        """The mean, that of azimuths about the one of the central point."""
        centre = Z[:, :1]
        offsets = self.residual(Z - centre, kind)
        return centre[:, 0] + offsets @ weights

    def residual(self, difference, kind):
        if kind == "radar":
            difference[1] = (difference[1] + np.pi) % (2 * np.pi) - np.pi
        return difference
