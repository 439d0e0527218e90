"""In the style of a course project in C++: KalmanFilter, Tools and FusionEKF with members x_, P_, F_, H_, R_, Q_."""

import numpy as np

RADAR, LASER = 0, 1


class MeasurementPackage:
    def __init__(self, scan):
        self.sensor_type_ = RADAR if scan.kind == "radar" else LASER
        self.raw_measurements_ = scan.measurement
        self.timestamp_ = round(scan.time * 1e6)  # microseconds
        self.valid_ = bool(scan.valid)
        self.R_ = scan.noise_covariance
        self.origin_ = scan.sensor_pose[:2]
        self.yaw_ = scan.sensor_pose[2]
        self.velocity_ = scan.sensor_velocity

    def rotation(self):
        c, s = np.cos(self.yaw_), np.sin(self.yaw_)
        return np.array([[c, s], [-s, c]])


class Tools:
    def CalculateJacobian(self, px, py, vx, vy):
        Hj = np.zeros((3, 4))
        c1 = px * px + py * py
        c2 = np.sqrt(c1)
        c3 = c1 * c2
        if abs(c1) < 0.0001:
            return Hj
        Hj[0, 0] = px / c2
        Hj[0, 1] = py / c2
        Hj[1, 0] = -py / c1
        Hj[1, 1] = px / c1
        Hj[2, 0] = py * (vx * py - vy * px) / c3
        Hj[2, 1] = px * (px * vy - py * vx) / c3
        Hj[2, 2] = px / c2
        Hj[2, 3] = py / c2
        return Hj

    def NormalizeAngle(self, angle):
        while angle > np.pi:
            angle -= 2.0 * np.pi
        while angle < -np.pi:
            angle += 2.0 * np.pi
        return angle


class KalmanFilter:
    def Init(self, x_in, P_in, F_in, H_in, R_in, Q_in):
        self.x_ = x_in
        self.P_ = P_in
        self.F_ = F_in
        self.H_ = H_in
        self.R_ = R_in
        self.Q_ = Q_in

    def Predict(self):
        self.x_ = self.F_ @ self.x_
        Ft = self.F_.T
        self.P_ = self.F_ @ self.P_ @ Ft + self.Q_

    def Update(self, z, z_pred):
        self.UpdateWithError(z - z_pred)

    def UpdateEKF(self, z, z_pred, tools):
        y = z - z_pred
        y[1] = tools.NormalizeAngle(y[1])
        self.UpdateWithError(y)

    def UpdateWithError(self, y):
        Ht = self.H_.T
        PHt = self.P_ @ Ht
        S = self.H_ @ PHt + self.R_
        Si = np.linalg.inv(S)
        K = PHt @ Si
        self.x_ = self.x_ + K @ y
        identity = np.eye(len(self.x_))
        self.P_ = (identity - K @ self.H_) @ self.P_
        self.P_ = 0.5 * (self.P_ + self.P_.T)


class FusionEKF:
    def __init__(self):
        self.is_initialized_ = False
        self.previous_timestamp_ = 0
        self.noise_ax = 9.0
        self.noise_ay = 9.0
        self.tools = Tools()
        self.ekf_ = KalmanFilter()

    def ProcessMeasurement(self, package):
        if not self.is_initialized_:
            self.InitializeState(package)
            self.previous_timestamp_ = package.timestamp_
            self.is_initialized_ = True
            return
        dt = (package.timestamp_ - self.previous_timestamp_) / 1000000.0
        self.previous_timestamp_ = package.timestamp_
        self.SetMotion(dt)
        self.ekf_.Predict()
        if not package.valid_:
            return
        rel = self.ekf_.x_[:2] - package.origin_
        self.ekf_.R_ = package.R_
        if package.sensor_type_ == RADAR:
            vel = self.ekf_.x_[2:] - package.velocity_
            rho = np.sqrt(rel @ rel)
            if rho < 0.01:
                return
            phi = self.tools.NormalizeAngle(np.arctan2(rel[1], rel[0]) - package.yaw_)
            rho_dot = (rel[0] * vel[0] + rel[1] * vel[1]) / rho
            self.ekf_.H_ = self.tools.CalculateJacobian(rel[0], rel[1], vel[0], vel[1])
            self.ekf_.UpdateEKF(package.raw_measurements_, np.array([rho, phi, rho_dot]), self.tools)
        else:
            self.ekf_.H_ = package.rotation() @ np.eye(2, 4)
            self.ekf_.Update(package.raw_measurements_, package.rotation() @ rel)

    def SetMotion(self, dt):
        dt_2 = dt * dt
        dt_3 = dt_2 * dt
        dt_4 = dt_3 * dt
        self.ekf_.F_[0, 2] = dt
        self.ekf_.F_[1, 3] = dt
        ax, ay = self.noise_ax, self.noise_ay
        self.ekf_.Q_ = np.array(
            [
                [dt_4 / 4 * ax, 0, dt_3 / 2 * ax, 0],
                [0, dt_4 / 4 * ay, 0, dt_3 / 2 * ay],
                [dt_3 / 2 * ax, 0, dt_2 * ax, 0],
                [0, dt_3 / 2 * ay, 0, dt_2 * ay],
            ]
        )

    def InitializeState(self, package):
        z = package.raw_measurements_
        local = z[0] * np.array([np.cos(z[1]), np.sin(z[1])]) if package.sensor_type_ == RADAR else z
        px, py = package.origin_ + package.rotation().T @ local
        P = np.diag([1.0, 1.0, 1000.0, 1000.0])
        self.ekf_.Init(np.array([px, py, 0.0, 0.0]), P, np.eye(4), np.eye(2, 4), package.R_, np.zeros((4, 4)))


class Tracker:
    def __init__(self):
        self.fusion_ = FusionEKF()

    def step(self, state, scan):
        self.fusion_.ProcessMeasurement(MeasurementPackage(scan))
        return None, (self.fusion_.ekf_.x_.copy(), self.fusion_.ekf_.P_.copy())
