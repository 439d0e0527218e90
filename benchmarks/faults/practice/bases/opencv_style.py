"""As cv::KalmanFilter: statePre and statePost are columns of 32-bit floats, and the caller sets the matrices."""

import numpy as np

CV_32F = np.float32


class KalmanFilter:
    def __init__(self, dynam_params, measure_params):
        self.statePre = np.zeros((dynam_params, 1), CV_32F)
        self.statePost = np.zeros((dynam_params, 1), CV_32F)
        self.transitionMatrix = np.eye(dynam_params, dtype=CV_32F)
        self.processNoiseCov = np.eye(dynam_params, dtype=CV_32F)
        self.measurementMatrix = np.zeros((measure_params, dynam_params), CV_32F)
        self.measurementNoiseCov = np.eye(measure_params, dtype=CV_32F)
        self.errorCovPre = np.zeros((dynam_params, dynam_params), CV_32F)
        self.errorCovPost = np.zeros((dynam_params, dynam_params), CV_32F)
        self.gain = np.zeros((dynam_params, measure_params), CV_32F)

    def copy(self):
        other = KalmanFilter(4, 2)
        other.__dict__.update({name: value.copy() for name, value in self.__dict__.items()})
        return other

    def predict(self):
        self.statePre = self.transitionMatrix @ self.statePost
        temp1 = self.transitionMatrix @ self.errorCovPost
        self.errorCovPre = temp1 @ self.transitionMatrix.T + self.processNoiseCov
        # in case that there is no measurement before the next prediction
        self.statePost = self.statePre.copy()
        self.errorCovPost = self.errorCovPre.copy()
        return self.statePre

    def correct(self, measurement):
        temp2 = self.measurementMatrix @ self.errorCovPre
        temp3 = temp2 @ self.measurementMatrix.T + self.measurementNoiseCov
        temp4 = np.linalg.solve(temp3, temp2)
        self.gain = temp4.T
        temp5 = measurement - self.measurementMatrix @ self.statePre
        self.statePost = self.statePre + self.gain @ temp5
        self.errorCovPost = self.errorCovPre - self.gain @ temp2
        self.errorCovPost = (self.errorCovPost + self.errorCovPost.T) / CV_32F(2)
        return self.statePost


def mat(values):
    return np.array(values, dtype=CV_32F)


class Tracker:
    """The origin is where the object was first seen: 32-bit floats have seven digits."""

    def step(self, state, scan):
        z, H, R = self.convert(scan, None if state is None else state["kf"])
        if state is None:
            kf = KalmanFilter(4, 2)
            kf.errorCovPost = mat(np.diag([0, 0, 400, 400]))
            kf.errorCovPost[:2, :2] = mat(R[:2, :2])
            state = {"kf": kf, "time": scan.time, "origin": z[:2].copy()}
            return state, self.estimate(state)
        kf = state["kf"].copy()
        dt = scan.time - state["time"]
        kf.transitionMatrix = mat([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1]])
        kf.processNoiseCov = self.process_noise(dt, 3.0)
        kf.predict()
        if scan.valid:
            z[:2] -= state["origin"]
            kf.measurementMatrix = mat(H)
            kf.measurementNoiseCov = mat(R)
            kf.correct(mat(z)[:, None])
        state = {"kf": kf, "time": scan.time, "origin": state["origin"]}
        return state, self.estimate(state)

    def process_noise(self, dt, sigma):
        a, b, c = dt**4 / 4, dt**3 / 2, dt**2
        return mat([[a, 0, b, 0], [0, a, 0, b], [b, 0, c, 0], [0, b, 0, c]]) * CV_32F(sigma**2)

    def convert(self, scan, kf):
        """Position, and the speed along a radar's ray, in the fixed frame."""
        yaw = scan.sensor_pose[2]
        if scan.kind == "lidar":
            T = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            return scan.sensor_pose[:2] + T @ scan.measurement, np.eye(2, 4), T @ scan.noise_covariance @ T.T
        r, theta, rate = scan.measurement
        c, s = np.cos(yaw + theta), np.sin(yaw + theta)
        velocity = np.zeros(2) if kf is None else kf.statePost[2:, 0].astype(float)
        rel = velocity - scan.sensor_velocity
        J = np.array([[c, -r * s, 0], [s, r * c, 0], [0, s * rel[0] - c * rel[1], 1]])
        z = np.array([*(scan.sensor_pose[:2] + r * np.array([c, s])), rate + scan.sensor_velocity @ [c, s]])
        H = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, c, s]])
        return z, H, J @ scan.noise_covariance @ J.T

    def estimate(self, state):
        mean = state["kf"].statePost[:, 0].astype(float)
        mean[:2] += state["origin"]
        return mean, state["kf"].errorCovPost.astype(float)
