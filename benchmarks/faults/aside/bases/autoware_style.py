"""After the tracker of Autoware: a Kalman filter object, and a motion model that predicts in short steps."""

import math
from copy import deepcopy

import numpy as np


class KalmanFilter:
    def __init__(self, x, P):
        self.x_, self.P_ = x, P

    def predict(self, x_next, A, Q):
        self.x_ = x_next
        self.P_ = A @ self.P_ @ A.T + Q

    def update(self, y, C, R):
        S = C @ self.P_ @ C.T + R
        K = self.P_ @ C.T @ np.linalg.inv(S)
        self.x_ = self.x_ + K @ (y - C @ self.x_)
        A = np.eye(len(self.x_)) - K @ C
        self.P_ = A @ self.P_ @ A.T + K @ R @ K.T


class IDX:
    X, Y, YAW, VEL, WZ = range(5)


class CTRVMotionModel:
    dt_max_ = 0.03

    def __init__(self, x, P, q_stddev_vel=0.8, q_stddev_wz=0.5, q_stddev_yaw=0.05):
        self.ekf_ = KalmanFilter(x, P)
        self.q_cov_vel, self.q_cov_wz, self.q_cov_yaw = q_stddev_vel**2, q_stddev_wz**2, q_stddev_yaw**2

    def predictState(self, dt):
        ekf = deepcopy(self.ekf_)
        repeat = max(math.ceil(dt / self.dt_max_), 1)
        for _ in range(repeat):
            self.predictStateStep(dt / repeat, ekf)
        self.ekf_ = ekf

    def predictStateStep(self, dt, ekf):
        X_t = ekf.x_
        yaw, vel, wz = X_t[IDX.YAW], X_t[IDX.VEL], X_t[IDX.WZ]
        sin_yaw, cos_yaw = math.sin(yaw + wz * dt / 2), math.cos(yaw + wz * dt / 2)
        X_next_t = X_t.copy()
        X_next_t[IDX.X] += vel * cos_yaw * dt
        X_next_t[IDX.Y] += vel * sin_yaw * dt
        X_next_t[IDX.YAW] += wz * dt
        A = np.eye(5)
        A[IDX.X, IDX.YAW] = -vel * sin_yaw * dt
        A[IDX.X, IDX.VEL] = cos_yaw * dt
        A[IDX.X, IDX.WZ] = -vel * sin_yaw * dt**2 / 2
        A[IDX.Y, IDX.YAW] = vel * cos_yaw * dt
        A[IDX.Y, IDX.VEL] = sin_yaw * dt
        A[IDX.Y, IDX.WZ] = vel * cos_yaw * dt**2 / 2
        A[IDX.YAW, IDX.WZ] = dt
        push = np.array([cos_yaw * dt / 2, sin_yaw * dt / 2, 0.0, 1.0, 0.0])
        Q = self.q_cov_vel * dt * np.outer(push, push)
        Q += np.diag([0, 0, self.q_cov_yaw * dt, 0, self.q_cov_wz * dt])
        ekf.predict(X_next_t, A, Q)

    def updateStatePose(self, x, y, cov):
        self.ekf_.update(np.array([x, y]), np.eye(2, 5), cov)
        self.ekf_.x_[IDX.YAW] = math.remainder(self.ekf_.x_[IDX.YAW], 2 * math.pi)

    def getPredictedState(self):
        x, P = self.ekf_.x_, self.ekf_.P_
        c, s = math.cos(x[IDX.YAW]), math.sin(x[IDX.YAW])
        J = np.eye(4, 5)
        J[2:, 2:] = [[-x[IDX.VEL] * s, c, 0], [x[IDX.VEL] * c, s, 0]]
        return np.array([x[IDX.X], x[IDX.Y], x[IDX.VEL] * c, x[IDX.VEL] * s]), J @ P @ J.T + 1e-9 * np.eye(4)


class Tracker:
    """A linear filter measures the course during the first second."""

    def step(self, state, scan):
        x, y, cov = self.toWorld(scan) if scan.valid else (None, None, None)
        if state is None:
            P = np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = cov
            kf = KalmanFilter(np.array([x, y, 0.0, 0.0]), P)
            return (scan.time, scan.time, kf), (kf.x_, kf.P_)
        time, begun, tracker = deepcopy(state)
        dt = scan.time - time
        if isinstance(tracker, CTRVMotionModel):
            tracker.predictState(dt)
            if scan.valid:
                tracker.updateStatePose(x, y, cov)
            return (scan.time, begun, tracker), tracker.getPredictedState()
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = 3 * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        tracker.predict(F @ tracker.x_, F, G @ G.T)
        if scan.valid:
            tracker.update(np.array([x, y]), np.eye(2, 4), cov)
        estimate = tracker.x_, tracker.P_
        vx, vy = tracker.x_[2:]
        vel = math.hypot(vx, vy)
        if scan.time - begun > 1 and vel > 2:
            J = np.zeros((5, 4))
            J[:2, :2], J[2, 2:], J[3, 2:] = np.eye(2), [-vy / vel**2, vx / vel**2], [vx / vel, vy / vel]
            initial = np.array([*tracker.x_[:2], math.atan2(vy, vx), vel, 0.0])
            tracker = CTRVMotionModel(initial, J @ tracker.P_ @ J.T + np.diag([0, 0, 0, 0, 0.04]))
        return (scan.time, begun, tracker), estimate

    def toWorld(self, scan):
        yaw = scan.sensor_pose[2]
        radar = scan.kind == "radar"
        r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if radar else (1.0, yaw)
        J = np.array([[math.cos(angle), -r * math.sin(angle)], [math.sin(angle), r * math.cos(angle)]])
        x, y = scan.sensor_pose[:2] + J @ (np.array([r, 0.0]) if radar else scan.measurement)
        return x, y, J @ scan.noise_covariance[:2, :2] @ J.T
