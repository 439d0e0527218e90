import numpy as np
from filterpy.common import Q_discrete_white_noise
from filterpy.kalman import ExtendedKalmanFilter


def hx(x, scan):
    dx, dy, ux, uy = x - [*scan.sensor_pose[:2], *scan.sensor_velocity]
    r = max(np.hypot(dx, dy), 1e-6)
    return np.array([r, np.arctan2(dy, dx) - scan.sensor_pose[2], (dx * ux + dy * uy) / r])


def HJacobian(x, scan):
    dx, dy, ux, uy = x - [*scan.sensor_pose[:2], *scan.sensor_velocity]
    r = max(np.hypot(dx, dy), 1e-6)
    c, s, turning = dx / r, dy / r, (dx * uy - dy * ux) / r**2
    return np.array([[c, s, 0, 0], [-s / r, c / r, 0, 0], [-s * turning, c * turning, c, s]])


def residual(a, b):
    y = a - b
    return np.array([y[0], (y[1] + np.pi) % (2 * np.pi) - np.pi, y[2]])


class FilterPyEkf:
    def __init__(self, acceleration_sigma=3.0):
        self.variance = acceleration_sigma**2

    def step(self, state, scan):
        (x, y, yaw), z, R, radar = scan.sensor_pose, scan.measurement, scan.noise_covariance, scan.kind == "radar"
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        position = [x, y] + turn @ (z[0] * np.array([np.cos(z[1]), np.sin(z[1])]) if radar else z)
        ekf = ExtendedKalmanFilter(dim_x=4, dim_z=3)  # px, py, vx, vy
        if state is None:  # the first measurement, and a velocity of up to about 40 m/s
            ekf.x, ekf.P = np.array([*position, 0, 0]), np.diag([1.0, 1, 400, 400])
            return (scan.time, ekf.x, ekf.P), (ekf.x, ekf.P)
        time, ekf.x, ekf.P = state
        dt = scan.time - time
        ekf.F = np.eye(4) + dt * np.eye(4, k=2)
        ekf.Q = Q_discrete_white_noise(2, dt, self.variance, block_size=2, order_by_dim=False)
        ekf.predict()
        if scan.valid and radar:
            ekf.update(z, HJacobian, hx, R, args=(scan,), hx_args=(scan,), residual=residual)
        elif scan.valid:
            ekf.update(position, lambda _: np.eye(2, 4), lambda x: x[:2], turn @ R @ turn.T)
        return (scan.time, ekf.x, ekf.P), (ekf.x, ekf.P)
