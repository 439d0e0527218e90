"""In the style of OpenCV: a linear KalmanFilter with statePre, statePost, errorCovPre and errorCovPost."""

import numpy as np


class KalmanFilter:
    def __init__(self, dynamParams):
        n = dynamParams
        self.statePre = np.zeros((n, 1))
        self.statePost = np.zeros((n, 1))
        self.transitionMatrix = np.eye(n)
        self.processNoiseCov = np.eye(n)
        self.measurementMatrix = np.zeros((2, n))
        self.measurementNoiseCov = np.eye(2)
        self.errorCovPre = np.zeros((n, n))
        self.errorCovPost = np.zeros((n, n))
        self.gain = np.zeros((n, 2))

    def predict(self):
        # x'(k) = A*x(k)
        self.statePre = self.transitionMatrix @ self.statePost
        # P'(k) = A*P(k)*At + Q
        temp1 = self.transitionMatrix @ self.errorCovPost
        self.errorCovPre = temp1 @ self.transitionMatrix.T + self.processNoiseCov
        # handle the case when there will be no measurement before the next predict
        self.statePost = self.statePre.copy()
        self.errorCovPost = self.errorCovPre.copy()
        return self.statePre

    def correct(self, measurement):
        # S = H*P'(k)*Ht + R, K = (inv(S)*H*P'(k))t
        temp2 = self.measurementMatrix @ self.errorCovPre
        temp3 = temp2 @ self.measurementMatrix.T + self.measurementNoiseCov
        temp4 = np.linalg.solve(temp3, temp2)
        self.gain = temp4.T
        temp5 = measurement - self.measurementMatrix @ self.statePre
        self.statePost = self.statePre + self.gain @ temp5
        # P(k) = P'(k) - K*temp2
        self.errorCovPost = self.errorCovPre - self.gain @ temp2
        self.errorCovPost = (self.errorCovPost + self.errorCovPost.T) / 2
        return self.statePost


class Tracker:
    """Positions in the fixed frame, and of a radar the speed along the line of sight."""

    def __init__(self, acceleration=3.0):
        self.acceleration = acceleration
        self.kf = None
        self.tick = 0.0

    def step(self, state, scan):
        if self.kf is None:
            self.initialise(scan)
        else:
            self.set_interval(scan.time - self.tick)
            self.kf.predict()
            if scan.valid:
                self.kf.correct(self.to_world(scan))
        self.tick = scan.time
        return None, (self.kf.statePost[:, 0].copy(), self.kf.errorCovPost.copy())

    def initialise(self, scan):
        self.kf = KalmanFilter(4)
        z = self.to_world(scan)
        self.kf.statePost[:2] = z[:2]
        self.kf.errorCovPost = np.diag([0.0, 0.0, 500.0, 500.0])
        self.kf.errorCovPost[:2, :2] = self.kf.measurementNoiseCov[:2, :2]

    def set_interval(self, dt):
        self.kf.transitionMatrix = np.array(
            [[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=np.float64
        )
        G = np.array([[dt * dt / 2, 0.0], [0.0, dt * dt / 2], [dt, 0.0], [0.0, dt]])
        self.kf.processNoiseCov = self.acceleration**2 * G @ G.T

    def to_world(self, scan):
        """The measurement as a column; sets H and R."""
        x, y, yaw = scan.sensor_pose
        cy, sy = np.cos(yaw), np.sin(yaw)
        if scan.kind == "lidar":
            R = np.array([[cy, -sy], [sy, cy]])
            self.kf.measurementMatrix = np.eye(2, 4)
            self.kf.measurementNoiseCov = R @ scan.noise_covariance @ R.T
            return np.array([[x], [y]]) + R @ scan.measurement[:, None]
        r, azimuth, rate = scan.measurement
        bearing = azimuth + yaw
        c, s = np.cos(bearing), np.sin(bearing)
        H = np.zeros((3, 4))
        H[0, 0] = H[1, 1] = 1.0
        H[2, 2], H[2, 3] = c, s
        J = np.array([[c, -r * s, 0.0], [s, r * c, 0.0], [0.0, 0.0, 1.0]])
        self.kf.measurementMatrix = H
        self.kf.measurementNoiseCov = J @ scan.noise_covariance @ J.T
        ego = scan.sensor_velocity
        return np.array([[x + r * c], [y + r * s], [rate + ego[0] * c + ego[1] * s]])
