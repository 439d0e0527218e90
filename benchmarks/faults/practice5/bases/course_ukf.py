"""The unscented filter of a course, brought over from its C++: px, py, v, yaw, yaw rate, and the two noises."""

import math

import numpy as np


def normalize(a):
    while a > math.pi:
        a -= 2.0 * math.pi
    while a < -math.pi:
        a += 2.0 * math.pi
    return a


class UKF:
    n_x_ = 5
    n_aug_ = 7
    std_a_ = 3.0
    std_yawdd_ = 1.0

    def __init__(self):
        self.x_ = np.zeros(5)
        self.P_ = np.eye(5)
        self.time_us_ = 0
        self.x_lin_ = self.P_lin_ = None
        self.is_initialized_ = False
        self.lambda_ = 3 - self.n_aug_
        self.weights_ = np.full(2 * self.n_aug_ + 1, 0.5 / (self.lambda_ + self.n_aug_))
        self.weights_[0] = self.lambda_ / (self.lambda_ + self.n_aug_)
        self.Xsig_pred_ = np.zeros((5, 15))

    def copy(self):
        other = UKF()
        other.__dict__.update({k: v.copy() if isinstance(v, np.ndarray) else v for k, v in self.__dict__.items()})
        return other

    def ProcessMeasurement(self, meas_package):
        if not self.is_initialized_:
            self.Initialize(meas_package)
            return
        delta_t = (meas_package.timestamp_ - self.time_us_) / 1000000.0
        self.time_us_ = meas_package.timestamp_
        while delta_t > 0.1:
            self.Prediction(0.05)
            delta_t -= 0.05
        self.Prediction(delta_t)
        if not meas_package.has_data_:
            return
        if meas_package.sensor_type_ == "LASER":
            self.UpdateLidar(meas_package)
        else:
            self.UpdateRadar(meas_package)

    def Position(self, meas_package):
        z, R, yaw = meas_package.raw_measurements_, meas_package.R_, meas_package.yaw_
        if meas_package.sensor_type_ == "RADAR":
            rho, a = z[0], yaw + z[1]
            J = np.array([[math.cos(a), -rho * math.sin(a)], [math.sin(a), rho * math.cos(a)]])
            return meas_package.position_ + rho * J[:, 0], J @ R[:2, :2] @ J.T
        J = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
        return meas_package.position_ + J @ z, J @ R @ J.T

    def Initialize(self, meas_package):
        """A linear filter of px, py, vx, vy until the yaw is known."""
        if self.x_lin_ is None:
            p, R = self.Position(meas_package)
            self.x_lin_ = np.array([p[0], p[1], 0.0, 0.0])
            self.P_lin_ = np.diag([0.0, 0.0, 400.0, 400.0])
            self.P_lin_[:2, :2] = R
            self.time_us_ = meas_package.timestamp_
            return
        dt = (meas_package.timestamp_ - self.time_us_) / 1000000.0
        self.time_us_ = meas_package.timestamp_
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = 3.0 * np.vstack([dt * dt / 2 * np.eye(2), dt * np.eye(2)])
        self.x_lin_, self.P_lin_ = F @ self.x_lin_, F @ self.P_lin_ @ F.T + G @ G.T
        if not meas_package.has_data_:
            return
        p, R = self.Position(meas_package)
        K = self.P_lin_[:, :2] @ np.linalg.inv(self.P_lin_[:2, :2] + R)
        self.x_lin_ = self.x_lin_ + K @ (p - self.x_lin_[:2])
        self.P_lin_ = self.P_lin_ - K @ self.P_lin_[:2]
        self.P_lin_ = 0.5 * (self.P_lin_ + self.P_lin_.T)
        vx, vy = self.x_lin_[2:]
        v = math.hypot(vx, vy)
        if v < 2.0 or v * v < 16.0 * np.trace(self.P_lin_[2:, 2:]):
            return
        T = np.zeros((5, 4))
        T[0, 0] = T[1, 1] = 1.0
        T[2, 2:] = vx / v, vy / v
        T[3, 2:] = -vy / v**2, vx / v**2
        self.x_ = np.array([*self.x_lin_[:2], v, math.atan2(vy, vx), 0.0])
        self.P_ = T @ self.P_lin_ @ T.T
        self.P_[4, 4] = 0.3**2
        self.is_initialized_ = True

    def GenerateSigmaPoints(self, x, P):
        n = len(x)
        Xsig = np.zeros((n, 2 * n + 1))
        Xsig[:, 0] = x
        L = np.linalg.cholesky(P + 1e-12 * np.eye(n))
        for i in range(n):
            Xsig[:, i + 1] = x + math.sqrt(self.lambda_ + self.n_aug_) * L[:, i]
            Xsig[:, i + 1 + n] = x - math.sqrt(self.lambda_ + self.n_aug_) * L[:, i]
        return Xsig

    def Prediction(self, delta_t):
        x_aug = np.zeros(self.n_aug_)
        x_aug[:5] = self.x_
        P_aug = np.zeros((self.n_aug_, self.n_aug_))
        P_aug[:5, :5] = self.P_
        P_aug[5, 5] = self.std_a_ * self.std_a_
        P_aug[6, 6] = self.std_yawdd_ * self.std_yawdd_
        Xsig_aug = self.GenerateSigmaPoints(x_aug, P_aug)

        for i in range(2 * self.n_aug_ + 1):
            p_x, p_y, v, yaw, yawd, nu_a, nu_yawdd = Xsig_aug[:, i]
            if abs(yawd) > 0.001:
                px_p = p_x + v / yawd * (math.sin(yaw + yawd * delta_t) - math.sin(yaw))
                py_p = p_y + v / yawd * (math.cos(yaw) - math.cos(yaw + yawd * delta_t))
            else:
                px_p = p_x + v * delta_t * math.cos(yaw)
                py_p = p_y + v * delta_t * math.sin(yaw)
            v_p = v
            yaw_p = yaw + yawd * delta_t
            yawd_p = yawd
            px_p += 0.5 * nu_a * delta_t * delta_t * math.cos(yaw)
            py_p += 0.5 * nu_a * delta_t * delta_t * math.sin(yaw)
            v_p += nu_a * delta_t
            yaw_p += 0.5 * nu_yawdd * delta_t * delta_t
            yawd_p += nu_yawdd * delta_t
            self.Xsig_pred_[:, i] = px_p, py_p, v_p, yaw_p, yawd_p

        self.x_ = self.Xsig_pred_ @ self.weights_
        P = np.zeros((5, 5))
        for i in range(2 * self.n_aug_ + 1):
            x_diff = self.Xsig_pred_[:, i] - self.x_
            P += self.weights_[i] * np.outer(x_diff, x_diff)
        self.P_ = P
        self.x_[3] = normalize(self.x_[3])

    def UpdateLidar(self, meas_package):
        c, s = math.cos(meas_package.yaw_), math.sin(meas_package.yaw_)
        H = np.array([[c, s, 0, 0, 0], [-s, c, 0, 0, 0]])
        y = meas_package.raw_measurements_ - H[:, :2] @ (self.x_[:2] - meas_package.position_)
        S = H @ self.P_ @ H.T + meas_package.R_
        K = self.P_ @ H.T @ np.linalg.inv(S)
        self.x_ = self.x_ + K @ y
        self.P_ = self.P_ - K @ S @ K.T
        self.x_[3] = normalize(self.x_[3])

    def UpdateRadar(self, meas_package):
        n = self.n_x_
        Xsig = self.GenerateSigmaPoints(self.x_, self.P_)
        weights = np.full(2 * n + 1, 0.5 / (self.lambda_ + self.n_aug_))
        weights[0] = 1.0 - n / (self.lambda_ + self.n_aug_)
        Zsig = np.zeros((3, 2 * n + 1))
        for i in range(2 * n + 1):
            p_x, p_y = Xsig[:2, i] - meas_package.position_
            v, yaw = Xsig[2, i], Xsig[3, i]
            v1 = math.cos(yaw) * v - meas_package.velocity_[0]
            v2 = math.sin(yaw) * v - meas_package.velocity_[1]
            rho = math.sqrt(p_x * p_x + p_y * p_y)
            Zsig[:, i] = rho, math.atan2(p_y, p_x) - meas_package.yaw_, (p_x * v1 + p_y * v2) / max(rho, 1e-3)

        # About the first point: the directions of the others differ from its one by little.
        Zsig[1] = [Zsig[1, 0] + normalize(phi - Zsig[1, 0]) for phi in Zsig[1]]
        z_pred = Zsig @ weights

        S = meas_package.R_.copy()
        Tc = np.zeros((n, 3))
        for i in range(2 * n + 1):
            z_diff = Zsig[:, i] - z_pred
            z_diff[1] = normalize(z_diff[1])
            x_diff = Xsig[:, i] - self.x_
            S += weights[i] * np.outer(z_diff, z_diff)
            Tc += weights[i] * np.outer(x_diff, z_diff)
        K = Tc @ np.linalg.inv(S)
        z_diff = meas_package.raw_measurements_ - z_pred
        z_diff[1] = normalize(z_diff[1])
        self.x_ = self.x_ + K @ z_diff
        self.P_ = self.P_ - K @ S @ K.T
        self.P_ = 0.5 * (self.P_ + self.P_.T)
        self.x_[3] = normalize(self.x_[3])


class MeasurementPackage:
    def __init__(self, scan):
        self.timestamp_ = round(scan.time * 1000000)
        self.sensor_type_ = "RADAR" if scan.kind == "radar" else "LASER"
        self.has_data_ = bool(scan.valid)
        self.raw_measurements_ = np.array(scan.measurement, dtype=float)
        self.R_ = np.array(scan.noise_covariance, dtype=float)
        self.position_ = np.array(scan.sensor_pose[:2], dtype=float)
        self.yaw_ = float(scan.sensor_pose[2])
        self.velocity_ = np.array(scan.sensor_velocity, dtype=float)


class Tracker:
    def step(self, state, scan):
        ukf = UKF() if state is None else state.copy()
        ukf.ProcessMeasurement(MeasurementPackage(scan))
        if not ukf.is_initialized_:
            return ukf, (ukf.x_lin_, ukf.P_lin_)
        v, yaw = ukf.x_[2], ukf.x_[3]
        c, s = math.cos(yaw), math.sin(yaw)
        T = np.zeros((4, 5))
        T[0, 0] = T[1, 1] = 1.0
        T[2, 2:4] = c, -v * s
        T[3, 2:4] = s, v * c
        P = T @ ukf.P_ @ T.T + 1e-9 * np.eye(4)
        return ukf, (np.array([ukf.x_[0], ukf.x_[1], v * c, v * s]), 0.5 * (P + P.T))
