"""After the projects of a course on self-driving cars: underscores end members, radar and lidar in one filter.

The radar may move: the filter holds the object relative to nothing, and takes the sensor's pose into the prediction.
"""

import copy
import math

import numpy as np


class KalmanFilter:
    def Init(self, x_in, P_in):
        self.x_, self.P_ = x_in, P_in

    def Predict(self):
        self.x_ = self.F_ @ self.x_
        self.P_ = self.F_ @ self.P_ @ self.F_.T + self.Q_

    def Update(self, z):
        self.Correct(z - self.H_ @ self.x_)

    def UpdateEKF(self, z, h_of_x):
        y = z - h_of_x
        while y[1] > math.pi:
            y[1] -= 2 * math.pi
        while y[1] < -math.pi:
            y[1] += 2 * math.pi
        self.Correct(y)

    def Correct(self, y):
        Ht = self.H_.T
        S = self.H_ @ self.P_ @ Ht + self.R_
        K = self.P_ @ Ht @ np.linalg.inv(S)
        self.x_ = self.x_ + K @ y
        self.P_ = (np.eye(4) - K @ self.H_) @ self.P_
        self.P_ = (self.P_ + self.P_.T) / 2


class FusionEKF:
    def __init__(self):
        self.is_initialized_ = False
        self.previous_timestamp_ = 0
        self.noise_ax = self.noise_ay = 9.0
        self.ekf_ = KalmanFilter()

    def ProcessMeasurement(self, scan):
        timestamp_ = round(1e6 * scan.time)  # µs
        if not self.is_initialized_:
            self.Start(scan)
            self.previous_timestamp_ = timestamp_
            return
        dt = (timestamp_ - self.previous_timestamp_) / 1000000.0
        self.previous_timestamp_ = timestamp_
        dt_2, dt_3, dt_4 = dt**2, dt**3, dt**4
        self.ekf_.F_ = np.array([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=float)
        self.ekf_.Q_ = np.array(
            [
                [dt_4 / 4 * self.noise_ax, 0, dt_3 / 2 * self.noise_ax, 0],
                [0, dt_4 / 4 * self.noise_ay, 0, dt_3 / 2 * self.noise_ay],
                [dt_3 / 2 * self.noise_ax, 0, dt_2 * self.noise_ax, 0],
                [0, dt_3 / 2 * self.noise_ay, 0, dt_2 * self.noise_ay],
            ]
        )
        self.ekf_.Predict()
        if not scan.valid:
            return
        self.ekf_.R_ = scan.noise_covariance
        if scan.kind == "radar":
            h_of_x, self.ekf_.H_ = self.Radar(self.ekf_.x_, scan)
            self.ekf_.UpdateEKF(scan.measurement.copy(), h_of_x)
        else:
            yaw = scan.sensor_pose[2]
            turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
            self.ekf_.H_ = np.hstack([turn, np.zeros((2, 2))])
            self.ekf_.Update(scan.measurement + turn @ scan.sensor_pose[:2])

    def Start(self, scan):
        px, py, yaw = scan.sensor_pose
        rho, phi = (scan.measurement[0], scan.measurement[1]) if scan.kind == "radar" else (1.0, 0.0)
        c, s = math.cos(yaw + phi), math.sin(yaw + phi)
        J = np.array([[c, -rho * s], [s, rho * c]])
        local = np.array([rho, 0.0]) if scan.kind == "radar" else scan.measurement
        P = np.diag([0.0, 0.0, 400.0, 400.0])
        P[:2, :2] = J @ scan.noise_covariance[:2, :2] @ J.T
        self.ekf_.Init(np.array([*(np.array([px, py]) + J @ local), 0.0, 0.0]), P)
        self.is_initialized_ = True

    def Radar(self, x_state, scan):
        px, py = x_state[:2] - scan.sensor_pose[:2]
        vx, vy = x_state[2:] - scan.sensor_velocity
        c1 = px * px + py * py
        rho = math.sqrt(c1)
        phi = math.atan2(py, px) - scan.sensor_pose[2]
        rho_dot = (px * vx + py * vy) / rho
        c3 = c1 * rho
        Hj = np.array(
            [
                [px / rho, py / rho, 0, 0],
                [-py / c1, px / c1, 0, 0],
                [py * (vx * py - vy * px) / c3, px * (vy * px - vx * py) / c3, px / rho, py / rho],
            ]
        )
        return np.array([rho, phi, rho_dot]), Hj


class Tracker:
    def step(self, state, scan):
        fusion = copy.deepcopy(state) if state is not None else FusionEKF()
        fusion.ProcessMeasurement(scan)
        return fusion, (fusion.ekf_.x_.copy(), fusion.ekf_.P_.copy())
