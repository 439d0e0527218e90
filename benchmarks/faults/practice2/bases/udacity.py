"""From a course project in C++: MeasurementPackage with microseconds, FusionEKF, KalmanFilter and Tools."""

import numpy as np


class MeasurementPackage:
    LASER, RADAR = 0, 1

    def __init__(self, scan):
        self.sensor_type_ = self.RADAR if scan.kind == "radar" else self.LASER
        self.timestamp_ = round(scan.time * 1e6)
        self.raw_measurements_ = scan.measurement.copy()
        self.pose_ = scan.sensor_pose.copy()
        self.ego_velocity_ = scan.sensor_velocity.copy()
        self.R_ = scan.noise_covariance.copy()
        self.detected_ = bool(scan.valid)


class Tools:
    @staticmethod
    def CalculateJacobian(x_state, ego_velocity):
        px, py, vx, vy = x_state
        vx = vx - ego_velocity[0]
        vy = vy - ego_velocity[1]
        c1 = max(px * px + py * py, 1e-4)
        c2 = np.sqrt(c1)
        c3 = c1 * c2
        return np.array(
            [
                [px / c2, py / c2, 0, 0],
                [-py / c1, px / c1, 0, 0],
                [py * (vx * py - vy * px) / c3, px * (px * vy - py * vx) / c3, px / c2, py / c2],
            ]
        )

    @staticmethod
    def NormalizeAngle(phi):
        while phi > np.pi:
            phi -= 2 * np.pi
        while phi < -np.pi:
            phi += 2 * np.pi
        return phi


class KalmanFilter:
    """The position is relative to where the sensor is, in fixed axes, while it is updated."""

    def __init__(self):
        self.x_ = np.zeros(4)
        self.P_ = np.zeros((4, 4))
        self.F_ = np.eye(4)
        self.Q_ = np.zeros((4, 4))

    def Predict(self):
        self.x_ = self.F_ @ self.x_
        self.P_ = self.F_ @ self.P_ @ self.F_.T + self.Q_

    def Update(self, z, pose, R):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        H = np.array([[c, s, 0, 0], [-s, c, 0, 0]])
        y = z - H @ self.x_
        self.UpdateWithError(y, H, R)

    def UpdateEKF(self, z, pose, ego_velocity, R):
        px, py, vx, vy = self.x_
        rho = np.sqrt(px * px + py * py)
        phi = np.arctan2(py, px) - pose[2]
        rho_dot = (px * (vx - ego_velocity[0]) + py * (vy - ego_velocity[1])) / max(rho, 1e-4)
        y = z - np.array([rho, phi, rho_dot])
        y[1] = Tools.NormalizeAngle(y[1])
        Hj = Tools.CalculateJacobian(self.x_, ego_velocity)
        self.UpdateWithError(y, Hj, R)

    def UpdateWithError(self, y, H, R):
        Ht = H.T
        S = H @ self.P_ @ Ht + R
        K = self.P_ @ Ht @ np.linalg.inv(S)
        self.x_ = self.x_ + K @ y
        self.P_ = (np.eye(4) - K @ H) @ self.P_
        self.P_ = 0.5 * (self.P_ + self.P_.T)


class FusionEKF:
    def __init__(self):
        self.is_initialized_ = False
        self.previous_timestamp_ = 0
        self.ekf_ = KalmanFilter()
        self.noise_ax, self.noise_ay = 9.0, 9.0

    def Clone(self):
        other = FusionEKF()
        other.is_initialized_ = self.is_initialized_
        other.previous_timestamp_ = self.previous_timestamp_
        other.ekf_.x_, other.ekf_.P_ = self.ekf_.x_.copy(), self.ekf_.P_.copy()
        return other

    def Initialize(self, pack):
        yaw = pack.pose_[2]
        R = pack.R_[:2, :2]
        if pack.sensor_type_ == MeasurementPackage.RADAR:
            rho, phi = pack.raw_measurements_[0], pack.raw_measurements_[1] + yaw
            local = np.array([rho * np.cos(phi), rho * np.sin(phi)])
            J = np.array([[np.cos(phi), -rho * np.sin(phi)], [np.sin(phi), rho * np.cos(phi)]])
        else:
            J = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            local = J @ pack.raw_measurements_
        self.ekf_.x_ = np.array([pack.pose_[0] + local[0], pack.pose_[1] + local[1], 0.0, 0.0])
        self.ekf_.P_ = np.diag([0.0, 0.0, 300.0, 300.0])
        self.ekf_.P_[:2, :2] = J @ R @ J.T
        self.previous_timestamp_ = pack.timestamp_
        self.is_initialized_ = True

    def ProcessMeasurement(self, pack):
        if not self.is_initialized_:
            self.Initialize(pack)
            return
        dt = (pack.timestamp_ - self.previous_timestamp_) / 1000000.0
        self.previous_timestamp_ = pack.timestamp_
        dt_2 = dt * dt
        dt_3 = dt_2 * dt
        dt_4 = dt_3 * dt
        self.ekf_.F_[0, 2] = dt
        self.ekf_.F_[1, 3] = dt
        self.ekf_.Q_ = np.array(
            [
                [dt_4 / 4 * self.noise_ax, 0, dt_3 / 2 * self.noise_ax, 0],
                [0, dt_4 / 4 * self.noise_ay, 0, dt_3 / 2 * self.noise_ay],
                [dt_3 / 2 * self.noise_ax, 0, dt_2 * self.noise_ax, 0],
                [0, dt_3 / 2 * self.noise_ay, 0, dt_2 * self.noise_ay],
            ]
        )
        self.ekf_.Predict()
        if not pack.detected_:
            return
        origin = np.array([pack.pose_[0], pack.pose_[1], 0.0, 0.0])
        self.ekf_.x_ = self.ekf_.x_ - origin
        if pack.sensor_type_ == MeasurementPackage.RADAR:
            self.ekf_.UpdateEKF(pack.raw_measurements_, pack.pose_, pack.ego_velocity_, pack.R_)
        else:
            self.ekf_.Update(pack.raw_measurements_, pack.pose_, pack.R_)
        self.ekf_.x_ = self.ekf_.x_ + origin


class Tracker:
    def step(self, state, scan):
        fusion = FusionEKF() if state is None else state.Clone()
        fusion.ProcessMeasurement(MeasurementPackage(scan))
        P = fusion.ekf_.P_
        return fusion, (fusion.ekf_.x_.copy(), 0.5 * (P + P.T))
