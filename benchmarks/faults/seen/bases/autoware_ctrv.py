"""In the style of Autoware: a KalmanFilter template, and a motion model with yaw, speed and yaw rate over it."""

import numpy as np

X, Y, YAW, VEL, WZ = 0, 1, 2, 3, 4
DIM = 5


def normalize_radian(rad):
    value = np.fmod(rad, 2.0 * np.pi)
    if value > np.pi:
        value -= 2.0 * np.pi
    if value < -np.pi:
        value += 2.0 * np.pi
    return value


class KalmanFilter:
    def __init__(self, x, P):
        self.x_ = x
        self.P_ = P

    def predict(self, x_next, A, Q):
        self.x_ = x_next
        self.P_ = A @ self.P_ @ A.T + Q

    def update(self, y, C, R):
        S = R + C @ self.P_ @ C.T
        K = self.P_ @ C.T @ np.linalg.inv(S)
        self.x_ = self.x_ + K @ y
        I_KC = np.eye(DIM) - K @ C
        self.P_ = I_KC @ self.P_ @ I_KC.T + K @ R @ K.T
        self.P_ = 0.5 * (self.P_ + self.P_.T)


class CTRVMotionModel:
    def __init__(self, q_acc=3.0, q_yaw_acc=0.6, dt_max=0.11):
        self.q_stddev_acc = q_acc
        self.q_stddev_yaw_acc = q_yaw_acc
        self.dt_max_ = dt_max
        self.last_update_time_ = None
        self.ekf_ = None

    def initialize(self, time, x, P):
        self.last_update_time_ = time
        self.ekf_ = KalmanFilter(x, P)

    def predictState(self, time):
        dt = time - self.last_update_time_
        if dt < 1e-6:
            return
        # if dt is too large, shorten dt and repeat prediction
        repeat = max(int(np.ceil(dt / self.dt_max_)), 1)
        for _ in range(repeat):
            self.predictStateStep(dt / repeat, self.ekf_)
        self.last_update_time_ = time

    def predictStateStep(self, dt, ekf):
        x, y, yaw, vel, wz = ekf.x_
        half = yaw + wz * dt / 2
        sin_yaw, cos_yaw = np.sin(half), np.cos(half)
        x_next = np.array([x + vel * cos_yaw * dt, y + vel * sin_yaw * dt, yaw + wz * dt, vel, wz])
        x_next[YAW] = normalize_radian(x_next[YAW])
        A = np.eye(DIM)
        A[X, YAW] = -vel * sin_yaw * dt
        A[X, VEL] = cos_yaw * dt
        A[X, WZ] = -0.5 * vel * sin_yaw * dt * dt
        A[Y, YAW] = vel * cos_yaw * dt
        A[Y, VEL] = sin_yaw * dt
        A[Y, WZ] = 0.5 * vel * cos_yaw * dt * dt
        A[YAW, WZ] = dt
        G = np.zeros((DIM, 2))
        G[X, 0], G[Y, 0], G[VEL, 0] = cos_yaw * dt * dt / 2, sin_yaw * dt * dt / 2, dt
        G[YAW, 1], G[WZ, 1] = dt * dt / 2, dt
        Q = G @ np.diag([self.q_stddev_acc**2, self.q_stddev_yaw_acc**2]) @ G.T
        Q[X, X] += 1e-6
        Q[Y, Y] += 1e-6
        ekf.predict(x_next, A, Q)

    def updateStatePose(self, z, R, scan):
        c, s = np.cos(scan.sensor_pose[2]), np.sin(scan.sensor_pose[2])
        C = np.zeros((2, DIM))
        C[:, :2] = [[c, s], [-s, c]]
        self.ekf_.update(z - C[:, :2] @ (self.ekf_.x_[:2] - scan.sensor_pose[:2]), C, R)

    def updateStateRadar(self, z, R, scan):
        yaw, vel = self.ekf_.x_[YAW], self.ekf_.x_[VEL]
        dx, dy = self.ekf_.x_[:2] - scan.sensor_pose[:2]
        r = max(np.hypot(dx, dy), 0.01)
        vx, vy = vel * np.cos(yaw) - scan.sensor_velocity[0], vel * np.sin(yaw) - scan.sensor_velocity[1]
        rate = (dx * vx + dy * vy) / r
        C = np.zeros((3, DIM))
        C[0, :2] = dx / r, dy / r
        C[1, :2] = -dy / r**2, dx / r**2
        C[2, :2] = (vx - rate * dx / r) / r, (vy - rate * dy / r) / r
        C[2, YAW] = (-dx * np.sin(yaw) + dy * np.cos(yaw)) * vel / r
        C[2, VEL] = (dx * np.cos(yaw) + dy * np.sin(yaw)) / r
        y = z - np.array([r, np.arctan2(dy, dx) - scan.sensor_pose[2], rate])
        y[1] = normalize_radian(y[1])
        self.ekf_.update(y, C, R)


class Tracker:
    """Waits until two positions, at least 0.2 s apart, give a course."""

    def __init__(self):
        self.motion_model_ = CTRVMotionModel()
        self.first_ = None

    def step(self, state, scan):
        model = self.motion_model_
        if model.ekf_ is None:
            if scan.valid:
                self.wait(scan)
        else:
            model.predictState(scan.time)
            if scan.valid and scan.kind == "radar":
                model.updateStateRadar(scan.measurement, scan.noise_covariance, scan)
            elif scan.valid:
                model.updateStatePose(scan.measurement, scan.noise_covariance, scan)
        return None, None if model.ekf_ is None else self.getTrackedObject()

    def wait(self, scan):
        x, y, yaw = scan.sensor_pose
        polar = scan.kind == "radar"
        r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if polar else (1.0, yaw)
        J = np.array([[np.cos(angle), -r * np.sin(angle)], [np.sin(angle), r * np.cos(angle)]])
        position = np.array([x, y]) + J @ ([r, 0.0] if polar else scan.measurement)
        R = J @ scan.noise_covariance[:2, :2] @ J.T
        if self.first_ is None:
            self.first_ = scan.time, position, R
        elif scan.time - self.first_[0] > 0.19:
            dt = scan.time - self.first_[0]
            v = (position - self.first_[1]) / dt
            speed = np.hypot(*v)
            var = np.trace(R + self.first_[2]) / 2 / dt**2
            P = np.diag([0.0, 0.0, min(var / max(speed, 0.1) ** 2, 4.0), var, 0.1])
            P[:2, :2] = R
            self.motion_model_.initialize(scan.time, np.array([*position, np.arctan2(v[1], v[0]), speed, 0.0]), P)

    def getTrackedObject(self):
        ekf = self.motion_model_.ekf_
        yaw, vel = ekf.x_[YAW], ekf.x_[VEL]
        c, s = np.cos(yaw), np.sin(yaw)
        J = np.zeros((4, DIM))
        J[0, X] = J[1, Y] = 1.0
        J[2, YAW], J[2, VEL] = -vel * s, c
        J[3, YAW], J[3, VEL] = vel * c, s
        return np.array([ekf.x_[X], ekf.x_[Y], vel * c, vel * s]), J @ ekf.P_ @ J.T + 1e-9 * np.eye(4)
