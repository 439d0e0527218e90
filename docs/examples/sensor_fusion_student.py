"""An extended Kalman filter for lidar and radar, as it is handed in for a course."""

import numpy as np


class Tracker:
    def __init__(self):
        self.is_initialized = False
        self.previous_timestamp = 0.0
        self.x = np.zeros(4)  # px, py, vx, vy
        self.P = np.diag([1.0, 1.0, 1000.0, 1000.0])
        self.H_laser = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
        self.noise_ax = 9.0
        self.noise_ay = 9.0

    def step(self, state, scan):
        if not self.is_initialized:
            self.x[:2] = self.first_position(scan)
            self.previous_timestamp = scan.time
            self.is_initialized = True
        else:
            self.predict(scan.time - self.previous_timestamp)
            self.previous_timestamp = scan.time
            if scan.valid and scan.kind == "radar":
                self.update_radar(scan)
            elif scan.valid:
                self.update_laser(scan)
        return None, (self.x.copy(), self.P.copy())

    def first_position(self, scan):
        sx, sy, yaw = scan.sensor_pose
        if scan.kind == "radar":
            rho, phi = scan.measurement[0], scan.measurement[1]
            return np.array([sx + rho * np.cos(yaw + phi), sy + rho * np.sin(yaw + phi)])
        return np.array([sx, sy]) + self.rotation(yaw).T @ scan.measurement

    def predict(self, dt):
        F = np.eye(4)
        F[0, 2] = F[1, 3] = dt
        G = np.array([[dt**2 / 2, 0.0], [0.0, dt**2 / 2], [dt, 0.0], [0.0, dt]])
        Q = G @ np.diag([self.noise_ax, self.noise_ay]) @ G.T
        self.x = F @ self.x
        self.P = F @ self.P @ F.T + Q

    def update_laser(self, scan):
        R_sensor = self.rotation(scan.sensor_pose[2])
        H = R_sensor @ self.H_laser
        y = scan.measurement - R_sensor @ (self.x[:2] - scan.sensor_pose[:2])
        self.correct(y, H, scan.noise_covariance)

    def update_radar(self, scan):
        sx, sy, yaw = scan.sensor_pose
        px, py = self.x[0] - sx, self.x[1] - sy
        vx, vy = self.x[2:] - scan.sensor_velocity
        rho = np.sqrt(px**2 + py**2)
        if rho < 0.0001:
            return
        phi = normalize(np.arctan2(py, px) - yaw)
        rho_dot = (px * vx + py * vy) / rho
        y = scan.measurement - np.array([rho, phi, rho_dot])
        Hj = np.array(
            [
                [px / rho, py / rho, 0.0, 0.0],
                [-py / rho**2, px / rho**2, 0.0, 0.0],
                [py * (vx * py - vy * px) / rho**3, px * (vy * px - vx * py) / rho**3, px / rho, py / rho],
            ]
        )
        self.correct(y, Hj, scan.noise_covariance)

    def correct(self, y, H, R):
        S = H @ self.P @ H.T + R
        K = self.P @ H.T @ np.linalg.inv(S)
        self.x = self.x + K @ y
        self.P = (np.eye(4) - K @ H) @ self.P
        self.P = (self.P + self.P.T) / 2

    def rotation(self, yaw):
        """From the fixed frame into the sensor's."""
        return np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])


def normalize(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi
