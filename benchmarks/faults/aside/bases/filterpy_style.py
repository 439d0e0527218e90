"""After FilterPy's KalmanFilter, as box trackers use it: columns, a fading memory, dot."""

import copy

import numpy as np
from numpy import dot, eye, zeros


class KalmanFilterNew:
    def __init__(self, dim_x, dim_z):
        self.dim_x, self.dim_z = dim_x, dim_z
        self.x = zeros((dim_x, 1))
        self.P = eye(dim_x)
        self.Q = eye(dim_x)
        self.F = eye(dim_x)
        self.H = zeros((dim_z, dim_x))
        self.R = eye(dim_z)
        self._alpha_sq = 1.0
        self._I = eye(dim_x)

    def predict(self):
        self.x = dot(self.F, self.x)
        self.P = self._alpha_sq * dot(dot(self.F, self.P), self.F.T) + self.Q

    def update(self, z):
        self.y = z - dot(self.H, self.x)
        PHT = dot(self.P, self.H.T)
        self.S = dot(self.H, PHT) + self.R
        self.SI = np.linalg.inv(self.S)
        self.K = dot(PHT, self.SI)
        self.x = self.x + dot(self.K, self.y)
        I_KH = self._I - dot(self.K, self.H)
        self.P = dot(dot(I_KH, self.P), I_KH.T) + dot(dot(self.K, self.R), self.K.T)


class PointTrack:
    """x, vx, y, vy: one axis after the other."""

    order = (0, 2, 1, 3)

    def __init__(self, z, R):
        self.kf = KalmanFilterNew(dim_x=4, dim_z=2)
        self.kf.H = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0]])
        self.kf.x[[0, 2], 0] = z
        self.kf.P = np.diag([1.0, 400.0, 1.0, 400.0])
        self.kf.P[np.ix_([0, 2], [0, 2])] = R

    def kalman_filter(self, dt, z=None, R=None):
        one_axis = np.array([[1.0, dt], [0.0, 1.0]])
        white = 9.0 * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
        self.kf.F = np.kron(eye(2), one_axis)
        self.kf.Q = np.kron(eye(2), white)
        self.kf.predict()
        if z is not None:
            self.kf.R = R
            self.kf.update(z.reshape(2, 1))
        self.x_state = self.kf.x

    def estimate(self):
        chosen = np.ix_(self.order, self.order)
        return self.kf.x[list(self.order), 0], (self.kf.P[chosen] + self.kf.P[chosen].T) / 2


class Tracker:
    def step(self, state, scan):
        z, R = self.detection(scan) if scan.valid else (None, None)
        if state is None:
            track = PointTrack(z, R)
        else:
            time, track = state[0], copy.deepcopy(state[1])
            track.kalman_filter(scan.time - time, z, R)
        return (scan.time, track), track.estimate()

    def detection(self, scan):
        yaw = scan.sensor_pose[2]
        r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if scan.kind == "radar" else (1.0, yaw)
        J = np.array([[np.cos(angle), -r * np.sin(angle)], [np.sin(angle), r * np.cos(angle)]])
        local = np.array([r, 0.0]) if scan.kind == "radar" else scan.measurement
        return scan.sensor_pose[:2] + dot(J, local), dot(dot(J, scan.noise_covariance[:2, :2]), J.T)
