"""A node carried over from C++: stamps of seconds and nanoseconds, a motion model with its EKF, long steps cut up."""

import copy
import math

import numpy as np


class Stamp:
    def __init__(self, seconds):
        self.sec = math.floor(seconds)
        self.nanosec = round((seconds - self.sec) * 1e9)

    def __sub__(self, other):
        return (self.sec - other.sec) + 1e-9 * (self.nanosec - other.nanosec)


class KalmanFilter:
    def __init__(self, x, P):
        self.x_, self.P_ = x, P

    def predict(self, x_next, A, Q):
        self.x_ = x_next
        self.P_ = A @ self.P_ @ A.T + Q

    def update(self, y, C, R):
        S = R + C @ self.P_ @ C.T
        K = self.P_ @ C.T @ np.linalg.inv(S)
        self.x_ = self.x_ + K @ (y - C @ self.x_)
        self.P_ = self.P_ - K @ (C @ self.P_)


class DetectedObject:
    """A detection in the map frame, with the covariance of its pose and its speed along the ray."""

    def __init__(self, scan):
        x, y, yaw = scan.sensor_pose
        m, R = scan.measurement, scan.noise_covariance
        self.has_twist = scan.kind == "radar"
        bearing = yaw + m[1] if self.has_twist else yaw
        r = m[0] if self.has_twist else 1.0
        J = np.array([[math.cos(bearing), -r * math.sin(bearing)], [math.sin(bearing), r * math.cos(bearing)]])
        offset = J @ np.array([r, 0.0]) if self.has_twist else J @ m
        self.pose = np.array([x, y]) + offset
        self.pose_covariance = J @ R[:2, :2] @ J.T
        if self.has_twist:
            self.ray = np.array([math.cos(bearing), math.sin(bearing)])
            self.twist = m[2] + self.ray @ scan.sensor_velocity
            self.twist_covariance = R[2, 2] + 0.15**2


class LinearMotionModel:
    """x, y, vx, vy."""

    def __init__(self, stamp, obj):
        self.last_update_time_ = stamp
        self.dt_max_ = 0.02
        self.q_stddev_acc = 3.0
        P = np.diag([1.0, 1.0, 20.0**2, 20.0**2])
        self.ekf_ = KalmanFilter(np.array([obj.pose[0], obj.pose[1], 0.0, 0.0]), P)

    def predictStateStep(self, dt, ekf):
        x_t = ekf.x_
        x_next_t = np.array([x_t[0] + x_t[2] * dt, x_t[1] + x_t[3] * dt, x_t[2], x_t[3]])
        A = np.eye(4) + dt * np.eye(4, k=2)
        q = self.q_stddev_acc**2 * 0.06  # spectral density
        one = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        ekf.predict(x_next_t, A, np.kron(one, np.eye(2)))

    def predictState(self, stamp):
        """Steps of dt_max_ at most, by a filter of its own that is taken over at the end."""
        dt = stamp - self.last_update_time_
        repeat = math.ceil(dt / self.dt_max_ - 1e-6)
        tmp_ekf_for_no_update = copy.copy(self.ekf_)
        for _ in range(repeat):
            self.predictStateStep(dt / repeat, tmp_ekf_for_no_update)
        self.ekf_ = tmp_ekf_for_no_update
        self.last_update_time_ = stamp

    def updateStatePose(self, obj):
        self.ekf_.update(obj.pose, np.eye(2, 4), obj.pose_covariance)

    def updateStateTwist(self, obj):
        C = np.concatenate([[0.0, 0.0], obj.ray])[None]
        self.ekf_.update(np.array([obj.twist]), C, np.array([[obj.twist_covariance]]))


class VehicleTracker:
    def __init__(self, scan):
        self.motion_model_ = LinearMotionModel(Stamp(scan.time), DetectedObject(scan))

    def predict(self, stamp):
        self.motion_model_.predictState(stamp)

    def measure(self, scan):
        obj = DetectedObject(scan)
        self.motion_model_.updateStatePose(obj)
        if obj.has_twist:
            self.motion_model_.updateStateTwist(obj)

    def getTrackedObject(self):
        ekf = self.motion_model_.ekf_
        return ekf.x_, (ekf.P_ + ekf.P_.T) / 2


class Tracker:
    """What the bench asks for."""

    def step(self, state, scan):
        if state is None:
            tracker = VehicleTracker(scan)
        else:
            tracker = copy.deepcopy(state)
            tracker.predict(Stamp(scan.time))
            if scan.valid:
                tracker.measure(scan)
        return tracker, tracker.getTrackedObject()
