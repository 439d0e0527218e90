"""After cv::KalmanFilter: pre and post states and covariances as columns and matrices, float64, set up for a point."""

import copy

import numpy as np


class KalmanFilter:
    def __init__(self, dynamParams, measureParams):
        self.statePre = np.zeros((dynamParams, 1))
        self.statePost = np.zeros((dynamParams, 1))
        self.transitionMatrix = np.eye(dynamParams)
        self.processNoiseCov = np.eye(dynamParams)
        self.measurementMatrix = np.zeros((measureParams, dynamParams))
        self.measurementNoiseCov = np.eye(measureParams)
        self.errorCovPre = np.zeros((dynamParams, dynamParams))
        self.errorCovPost = np.zeros((dynamParams, dynamParams))

    def predict(self):
        self.statePre = self.transitionMatrix @ self.statePost
        temp = self.transitionMatrix @ self.errorCovPost
        self.errorCovPre = temp @ self.transitionMatrix.T + self.processNoiseCov
        # where no measurement comes before the next prediction
        self.statePost = self.statePre.copy()
        self.errorCovPost = self.errorCovPre.copy()
        return self.statePre

    def correct(self, measurement):
        temp2 = self.measurementMatrix @ self.errorCovPre
        temp3 = temp2 @ self.measurementMatrix.T + self.measurementNoiseCov
        gain = np.linalg.solve(temp3, temp2).T
        temp5 = measurement - self.measurementMatrix @ self.statePre
        self.statePost = self.statePre + gain @ temp5
        self.errorCovPost = self.errorCovPre - gain @ temp2
        return self.statePost


class PointTracker:
    """State x, y, vx, vy."""

    def __init__(self, pt, cov, deltaTime=0.05, accelNoiseMag=3.0):
        self.kalman = KalmanFilter(4, 2)
        self.deltaTime, self.accelNoiseMag = deltaTime, accelNoiseMag
        self.kalman.measurementMatrix[0, 0] = self.kalman.measurementMatrix[1, 1] = 1.0
        self.kalman.statePost[:2, 0] = pt
        self.kalman.errorCovPost[:2, :2] = cov
        self.kalman.errorCovPost[2, 2] = self.kalman.errorCovPost[3, 3] = 400.0

    def setDeltaTime(self, deltaTime):
        self.deltaTime = deltaTime
        dt = self.deltaTime
        self.kalman.transitionMatrix = np.array([[1, 0, dt, 0], [0, 1, 0, dt], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=float)
        n1, n2, n3 = dt**4 / 4, dt**3 / 2, dt**2
        noise = np.array([[n1, 0, n2, 0], [0, n1, 0, n2], [n2, 0, n3, 0], [0, n2, 0, n3]])
        self.kalman.processNoiseCov = self.accelNoiseMag**2 * noise

    def getPrediction(self, deltaTime):
        self.setDeltaTime(deltaTime)
        return self.kalman.predict()

    def update(self, pt, cov):
        self.kalman.measurementNoiseCov = cov
        return self.kalman.correct(np.reshape(pt, (2, 1)))


class Tracker:
    def step(self, state, scan):
        pt, cov = self.point(scan) if scan.valid else (None, None)
        if state is None:
            tracker = PointTracker(pt, cov)
        else:
            time, tracker = state[0], copy.deepcopy(state[1])
            tracker.getPrediction(scan.time - time)
            if scan.valid:
                tracker.update(pt, cov)
        mean = tracker.kalman.statePost[:, 0]
        return (scan.time, tracker), (mean.copy(), (tracker.kalman.errorCovPost + tracker.kalman.errorCovPost.T) / 2)

    def point(self, scan):
        x, y, yaw = scan.sensor_pose
        if scan.kind == "radar":
            rho, phi = scan.measurement[0], yaw + scan.measurement[1]
            J = np.array([[np.cos(phi), -rho * np.sin(phi)], [np.sin(phi), rho * np.cos(phi)]])
            local = np.array([rho, 0.0])
        else:
            J = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            local = scan.measurement
        return np.array([x, y]) + J @ local, J @ scan.noise_covariance[:2, :2] @ J.T
