"""An extended Kalman filter of constant turn rate and speed. A linear one runs until the object has a course."""

import numpy as np


def wrapped(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


class Tracker:
    """State px, py, yaw, speed, yaw rate."""

    def __init__(self, acceleration_sigma=3.0, yaw_acceleration_sigma=0.6):
        self.sigma_a, self.sigma_yaw = acceleration_sigma, yaw_acceleration_sigma

    def step(self, state, scan):
        if state is None:
            z, R = self.position(scan)
            x, P = np.array([*z, 0.0, 0.0]), np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            return (scan.time, scan.time, x, P), (x, P)
        time, begun, x, P = state
        dt = scan.time - time
        x, P = self.predict(x, P, dt) if len(x) == 5 else self.predict_linear(x, P, dt)
        if scan.valid:
            z, R = self.position(scan)
            y, S = z - x[:2], P[:2, :2] + R
            K = P[:, :2] @ np.linalg.inv(S)
            A = np.eye(len(x)) - K @ np.eye(2, len(x))
            x, P = x + K @ y, A @ P @ A.T + K @ R @ K.T
        if len(x) == 4:
            started = self.with_course(x, P) if scan.time - begun > 1 and np.hypot(x[2], x[3]) > 2 else (x, P)
            return (scan.time, begun, *started), (x, P)
        x[2] = wrapped(x[2])
        return (scan.time, begun, x, P), self.cartesian(x, P)

    def predict_linear(self, x, P, dt):
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = self.sigma_a * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        return F @ x, F @ P @ F.T + G @ G.T

    def with_course(self, x, P):
        vx, vy = x[2:]
        speed = np.hypot(vx, vy)
        J = np.zeros((5, 4))
        J[:2, :2], J[2, 2:], J[3, 2:] = np.eye(2), [-vy / speed**2, vx / speed**2], [vx / speed, vy / speed]
        return np.array([x[0], x[1], np.arctan2(vy, vx), speed, 0.0]), J @ P @ J.T + np.diag([0, 0, 0, 0, 0.04])

    def predict(self, x, P, dt):
        moved = self.move(x, dt)
        JA = self.calculate_jacobian(x, dt)
        c, s = np.cos(x[2]), np.sin(x[2])
        G = np.array([[c * dt**2 / 2, 0], [s * dt**2 / 2, 0], [0, dt**2 / 2], [dt, 0], [0, dt]])
        Q = G @ np.diag([self.sigma_a**2, self.sigma_yaw**2]) @ G.T
        return moved, JA @ P @ JA.T + Q

    def move(self, x, dt):
        px, py, yaw, speed, yaw_rate = x
        turned = yaw + dt * yaw_rate
        if abs(yaw_rate) < 1e-4:
            return np.array([px + speed * dt * np.cos(yaw), py + speed * dt * np.sin(yaw), turned, speed, yaw_rate])
        turn_radius = speed / yaw_rate
        px += turn_radius * (np.sin(turned) - np.sin(yaw))
        py += turn_radius * (np.cos(yaw) - np.cos(turned))
        return np.array([px, py, turned, speed, yaw_rate])

    def calculate_jacobian(self, x, dt):
        _, _, yaw, speed, yaw_rate = x
        turned = yaw + dt * yaw_rate
        J = np.eye(5)
        J[2, 4] = dt
        if abs(yaw_rate) < 1e-4:
            c, s = dt * np.cos(yaw), dt * np.sin(yaw)
            J[0, 2:] = [-speed * s, c, -speed * s * dt / 2]
            J[1, 2:] = [speed * c, s, speed * c * dt / 2]
            return J
        turn_radius = speed / yaw_rate
        sines, cosines = np.sin(turned) - np.sin(yaw), np.cos(yaw) - np.cos(turned)
        J[0, 2] = turn_radius * (np.cos(turned) - np.cos(yaw))
        J[1, 2] = turn_radius * (np.sin(turned) - np.sin(yaw))
        J[0, 3:] = [sines / yaw_rate, turn_radius * (dt * np.cos(turned) - sines / yaw_rate)]
        J[1, 3:] = [cosines / yaw_rate, turn_radius * (dt * np.sin(turned) - cosines / yaw_rate)]
        return J

    def cartesian(self, x, P):
        speed, c, s = x[3], np.cos(x[2]), np.sin(x[2])
        J = np.eye(4, 5)
        J[2:, 2:] = [[-speed * s, c, 0], [speed * c, s, 0]]
        return np.array([x[0], x[1], speed * c, speed * s]), J @ P @ J.T + 1e-9 * np.eye(4)

    def position(self, scan):
        radar, yaw = scan.kind == "radar", scan.sensor_pose[2]
        r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if radar else (1.0, yaw)
        c, s = np.cos(angle), np.sin(angle)
        J = np.array([[c, -r * s], [s, r * c]])
        z = scan.sensor_pose[:2] + J @ (np.array([r, 0.0]) if radar else scan.measurement)
        return z, J @ scan.noise_covariance[:2, :2] @ J.T
