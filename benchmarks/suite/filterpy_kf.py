"""FilterPy's Kalman filter at constant velocity on the positions of a lidar."""

import numpy as np
from filterpy.common import Q_discrete_white_noise
from filterpy.kalman import KalmanFilter


class FilterPyKf:
    def __init__(self, acceleration_sigma):
        self.variance = acceleration_sigma**2

    def step(self, state, scan):
        kf = KalmanFilter(dim_x=4, dim_z=2)  # px, py, vx, vy
        if scan.valid:
            x, y, yaw = scan.sensor_pose
            turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            position = [x, y] + turn @ scan.measurement
            kf.H, kf.R = np.eye(2, 4), turn @ scan.noise_covariance @ turn.T
        if state is None:  # the first measurement, and a velocity of up to about 40 m/s
            kf.x, kf.P = np.array([*position, 0, 0]), np.diag([1.0, 1, 400, 400])
            return (scan.time, kf.x, kf.P), (kf.x, kf.P)
        time, kf.x, kf.P = state
        dt = scan.time - time
        kf.F = np.eye(4) + dt * np.eye(4, k=2)
        kf.Q = Q_discrete_white_noise(2, dt, self.variance, block_size=2, order_by_dim=False)
        kf.predict()
        if not scan.valid:  # the noise is constant from one measurement to the next, however often it is predicted
            return state, (kf.x, kf.P)
        kf.update(position)
        return (scan.time, kf.x, kf.P), (kf.x, kf.P)
