"""EKF with constant turn rate and velocity, in the manner of a course project: x = [px, py, v, yaw, yaw_rate]."""

import copy

import numpy as np
from numpy import cos, sin


class Tools:
    @staticmethod
    def to_sensor(x, pose, sensor_velocity):
        """Radar measurement (rho, phi, rho_dot) of a CTRV state, and the Jacobian Hj."""
        px, py, v, yaw = x[0] - pose[0], x[1] - pose[1], x[2], x[3]
        vx, vy = v * cos(yaw) - sensor_velocity[0], v * sin(yaw) - sensor_velocity[1]
        rho2 = max(px * px + py * py, 1e-4)
        rho = np.sqrt(rho2)
        dot = px * vx + py * vy
        z_pred = np.array([rho, np.arctan2(py, px) - pose[2], dot / rho])
        cross = (vx * py - vy * px) / (rho2 * rho)
        Hj = np.zeros((3, 5))
        Hj[0, :2] = px / rho, py / rho
        Hj[1, :2] = -py / rho2, px / rho2
        Hj[2, 0] = py * cross
        Hj[2, 1] = -px * cross
        Hj[2, 2] = (px * cos(yaw) + py * sin(yaw)) / rho
        Hj[2, 3] = v * (py * cos(yaw) - px * sin(yaw)) / rho
        return z_pred, Hj

    @staticmethod
    def normalize(angle):
        while angle > np.pi:
            angle -= 2.0 * np.pi
        while angle < -np.pi:
            angle += 2.0 * np.pi
        return angle


class FusionEKF:
    """Starts as a filter of constant velocity, which says after half a second in which direction the car drives."""

    std_a = 2.5  # m/s^2
    std_yawdd = 1.0  # rad/s^2
    warm_up = 0.5  # s

    def __init__(self, scan):
        self.started = self.previous_timestamp = scan.time
        self.linear = True
        psi = scan.sensor_pose[2]
        if scan.kind == "radar":
            rho, phi = scan.measurement[:2]
            a = psi + phi
            J = np.array([[cos(a), -rho * sin(a)], [sin(a), rho * cos(a)]])
            offset = rho * np.array([cos(a), sin(a)])
        else:
            J = np.array([[cos(psi), -sin(psi)], [sin(psi), cos(psi)]])
            offset = J @ scan.measurement
        self.x = np.array([*(scan.sensor_pose[:2] + offset), 0.0, 0.0])
        self.P = np.diag([0.0, 0.0, 400.0, 400.0])
        self.P[:2, :2] = J @ scan.noise_covariance[:2, :2] @ J.T

    def predict(self, timestamp):
        dt = timestamp - self.previous_timestamp
        self.previous_timestamp = timestamp
        if self.linear:
            F = np.eye(4)
            F[0, 2] = F[1, 3] = dt
            G = np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
            self.x = F @ self.x
            self.P = F @ self.P @ F.T + self.std_a**2 * G @ G.T
            return
        px, py, v, yaw, yawd = self.x
        F = np.eye(5)
        F[3, 4] = dt
        if abs(yawd) > 1e-3:
            r = v / yawd
            yaw_p = yaw + yawd * dt
            px_p = px + r * (sin(yaw_p) - sin(yaw))
            py_p = py + r * (cos(yaw) - cos(yaw_p))
            F[0, 2] = (sin(yaw_p) - sin(yaw)) / yawd
            F[1, 2] = (cos(yaw) - cos(yaw_p)) / yawd
            F[0, 3] = r * (cos(yaw_p) - cos(yaw))
            F[1, 3] = r * (sin(yaw_p) - sin(yaw))
            F[0, 4] = r * dt * cos(yaw_p) - r / yawd * (sin(yaw_p) - sin(yaw))
            F[1, 4] = r * dt * sin(yaw_p) - r / yawd * (cos(yaw) - cos(yaw_p))
        else:
            yaw_p = yaw + yawd * dt
            px_p = px + v * dt * cos(yaw)
            py_p = py + v * dt * sin(yaw)
            F[0, 2] = dt * cos(yaw)
            F[1, 2] = dt * sin(yaw)
            F[0, 3] = -v * dt * sin(yaw)
            F[1, 3] = v * dt * cos(yaw)
            F[0, 4] = -0.5 * v * dt**2 * sin(yaw)
            F[1, 4] = 0.5 * v * dt**2 * cos(yaw)
        G = np.array(
            [
                [0.5 * dt**2 * cos(yaw), 0.0],
                [0.5 * dt**2 * sin(yaw), 0.0],
                [dt, 0.0],
                [0.0, 0.5 * dt**2],
                [0.0, dt],
            ]
        )
        Q = G @ np.diag([self.std_a**2, self.std_yawdd**2]) @ G.T
        self.x = np.array([px_p, py_p, v, yaw_p, yawd])
        self.P = F @ self.P @ F.T + Q

    def update(self, scan):
        if scan.kind == "radar":
            z_pred, H = Tools.to_sensor(self.polar(), scan.sensor_pose, scan.sensor_velocity)
            if self.linear:
                H = np.hstack([H[:, :2], np.zeros((3, 2))])
                H[2, 2:] = self.line_of_sight(scan.sensor_pose)
            y = scan.measurement - z_pred
            y[1] = Tools.normalize(y[1])
        else:
            psi = scan.sensor_pose[2]
            T = np.array([[cos(psi), sin(psi)], [-sin(psi), cos(psi)]])
            H = np.zeros((2, len(self.x)))
            H[:, :2] = T
            y = scan.measurement - T @ (self.x[:2] - scan.sensor_pose[:2])
        R = scan.noise_covariance
        S = H @ self.P @ H.T + R
        K = self.P @ H.T @ np.linalg.inv(S)
        self.x = self.x + K @ y
        A = np.eye(len(self.x)) - K @ H
        self.P = A @ self.P @ A.T + K @ R @ K.T
        if self.linear and scan.time - self.started > self.warm_up:
            self.switch()

    def polar(self):
        """The state with speed and course."""
        if not self.linear:
            return self.x
        return np.array([self.x[0], self.x[1], np.hypot(self.x[2], self.x[3]), np.arctan2(self.x[3], self.x[2]), 0.0])

    def line_of_sight(self, pose):
        d = self.x[:2] - pose[:2]
        return d / np.linalg.norm(d)

    @staticmethod
    def velocity_jacobian(x):
        """Of px, py, vx, vy by px, py, v, yaw."""
        v, yaw = x[2], x[3]
        J = np.eye(4)
        J[2, 2] = cos(yaw)
        J[2, 3] = -v * sin(yaw)
        J[3, 2] = sin(yaw)
        J[3, 3] = v * cos(yaw)
        return J

    def switch(self):
        """From constant velocity to CTRV."""
        x = self.polar()
        if x[2] < 2.0:
            return
        J = np.linalg.inv(self.velocity_jacobian(x))
        P = np.zeros((5, 5))
        P[:4, :4] = J @ self.P @ J.T
        P[4, 4] = 0.4**2
        self.x, self.P, self.linear = x, P, False

    def estimate(self):
        if self.linear:
            return self.x, self.P
        px, py, v, yaw, _ = self.x
        J = self.velocity_jacobian(self.x)
        return np.array([px, py, v * cos(yaw), v * sin(yaw)]), J @ self.P[:4, :4] @ J.T


class Tracker:
    def step(self, state, scan):
        if state is None:
            ekf = FusionEKF(scan)
            return ekf, ekf.estimate()
        ekf = copy.deepcopy(state)
        ekf.predict(scan.time)
        if scan.valid:
            ekf.update(scan)
        return ekf, ekf.estimate()
