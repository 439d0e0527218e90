"""A linear Kalman filter: every measurement is first turned into a position in the fixed frame. Constant velocity."""

import numpy as np


class Tracker:
    """State px, py, vx, vy. Continuous white acceleration of the given spectral density, m²/s³."""

    def __init__(self, density=4.0, velocity_sigma=20.0):
        self.density = density
        self.velocity_sigma = velocity_sigma

    def step(self, state, scan):
        if state is None:
            position, noise = self.position(scan)
            mean = np.array([*position, 0.0, 0.0])
            covariance = np.diag([0.0, 0.0, self.velocity_sigma**2, self.velocity_sigma**2])
            covariance[:2, :2] = noise
            return (scan.time, mean, covariance), (mean, covariance)
        last_time, mean, covariance = state
        predicted_mean, predicted = self.predict(mean, covariance, scan.time - last_time)
        if not scan.valid:
            return (scan.time, predicted_mean, predicted), (predicted_mean, predicted)
        position, noise = self.position(scan)
        mean, updated = self.filter_update(predicted_mean, predicted, position, observation_covariance=noise)
        return (scan.time, mean, updated), (mean, updated)

    def predict(self, mean, covariance, dt):
        F = np.array([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=float)
        return F @ mean, F @ covariance @ F.T + self.continuous_white_noise(dt)

    def continuous_white_noise(self, dt):
        one_axis = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        return self.density * np.kron(one_axis, np.eye(2))

    def filter_update(self, mean, covariance, observation, observation_covariance=None):
        H, default_covariance = self.initialize_parameters()
        if observation_covariance is None:
            observation_covariance = default_covariance
        innovation = observation - H @ mean
        S = H @ covariance @ H.T + observation_covariance
        K = np.linalg.solve(S, H @ covariance).T
        return mean + K @ innovation, self.joseph(covariance, K, H, observation_covariance)

    def initialize_parameters(self):
        return np.eye(2, 4), np.eye(2)

    def joseph(self, covariance, K, H, R):
        A = np.eye(4) - K @ H
        return A @ covariance @ A.T + K @ R @ K.T

    def position(self, scan):
        """The position in the fixed frame and its covariance, that of a radar linearised."""
        x, y, yaw = scan.sensor_pose
        if scan.kind == "radar":
            distance, azimuth = scan.measurement[0], yaw + scan.measurement[1]
            c, s = np.cos(azimuth), np.sin(azimuth)
            J = np.array([[c, -distance * s], [s, distance * c]])
            return np.array([x + distance * c, y + distance * s]), J @ scan.noise_covariance[:2, :2] @ J.T
        c, s = np.cos(yaw), np.sin(yaw)
        J = np.array([[c, -s], [s, c]])
        return np.array([x, y]) + J @ scan.measurement, J @ scan.noise_covariance @ J.T
