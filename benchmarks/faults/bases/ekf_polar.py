"""An extended Kalman filter that predicts range, azimuth and range rate of a moving radar, and x, y of a lidar."""

import math

import numpy as np


def wrap(angle):
    return (angle + math.pi) % (2 * math.pi) - math.pi


class Tracker:
    """State px, py, vx, vy with white acceleration that is constant over a step."""

    def __init__(self, acceleration_sigma=3.0, speed_sigma=20.0):
        self.acceleration_sigma = acceleration_sigma
        self.speed_sigma = speed_sigma
        self.memory = {}

    def step(self, state, scan):
        if state is None:
            x, P = self.start(scan)
            return (scan.time, x, P), (x, P)
        last, x, P = state
        x, P = self.predict(x, P, scan.time - last)
        if not scan.valid:
            return (scan.time, x, P), (x, P)
        x, P = self.update(x, P, scan)
        return (scan.time, x, P), (x, P)

    def start(self, scan):
        """From the first measurement: a radar knows the speed along the ray, nobody the rest."""
        px, py, yaw = scan.sensor_pose
        if scan.kind == "radar":
            r, azimuth, rate = scan.measurement
            var_r, var_azimuth, var_rate = np.diag(scan.noise_covariance)
            ray = np.array([math.cos(yaw + azimuth), math.sin(yaw + azimuth)])
            across = np.array([-ray[1], ray[0]])
            rate_over_ground = rate + ray @ scan.sensor_velocity
            position, velocity = np.array([px, py]) + r * ray, rate_over_ground * ray
            P_position = var_r * np.outer(ray, ray) + r**2 * var_azimuth * np.outer(across, across)
            P_velocity = var_rate * np.outer(ray, ray) + self.speed_sigma**2 * np.outer(across, across)
        else:
            turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
            position, velocity = np.array([px, py]) + turn @ scan.measurement, np.zeros(2)
            P_position, P_velocity = turn @ scan.noise_covariance @ turn.T, self.speed_sigma**2 * np.eye(2)
        P = np.zeros((4, 4))
        P[:2, :2], P[2:, 2:] = P_position, P_velocity
        return np.concatenate([position, velocity]), P

    def predict(self, x, P, dt):
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = self.acceleration_sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        return F @ x, F @ P @ F.T + G @ G.T

    def update(self, x, P, scan):
        expected, H = self.radar(x, scan) if scan.kind == "radar" else self.lidar(x, scan)
        innovation = scan.measurement - expected
        if scan.kind == "radar":
            innovation[1] = wrap(innovation[1])
        S = H @ P @ H.T + scan.noise_covariance
        K = P @ H.T @ np.linalg.inv(S)
        A = np.eye(4) - K @ H
        return x + K @ innovation, A @ P @ A.T + K @ scan.noise_covariance @ K.T

    def radar(self, x, scan):
        dx, dy = x[:2] - scan.sensor_pose[:2]
        ux, uy = x[2:] - scan.sensor_velocity
        r = math.hypot(dx, dy)
        range_rate = (dx * ux + dy * uy) / r
        expected = np.array([r, wrap(math.atan2(dy, dx) - scan.sensor_pose[2]), range_rate])
        swing = (ux * dy - uy * dx) / r**3
        H = [
            [dx / r, dy / r, 0, 0],
            [-dy / r**2, dx / r**2, 0, 0],
            [dy * swing, -dx * swing, dx / r, dy / r],
        ]
        return expected, np.array(H)

    def lidar(self, x, scan):
        yaw = scan.sensor_pose[2]
        into_sensor = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
        return into_sensor @ (x[:2] - scan.sensor_pose[:2]), np.hstack([into_sensor, np.zeros((2, 2))])
