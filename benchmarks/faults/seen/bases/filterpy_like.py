"""In the style of FilterPy: a general ExtendedKalmanFilter with column vectors, and functions for the sensors."""

import numpy as np
from numpy import dot, zeros


class ExtendedKalmanFilter:
    def __init__(self, dim_x):
        self.dim_x = dim_x
        self.x = zeros((dim_x, 1))
        self.P = np.eye(dim_x)
        self.F = np.eye(dim_x)
        self.Q = np.eye(dim_x)
        self._alpha_sq = 1.0  # fading memory
        self._I = np.eye(dim_x)
        self.x_prior, self.P_prior = self.x.copy(), self.P.copy()
        self.x_post, self.P_post = self.x.copy(), self.P.copy()

    def predict(self):
        self.x = dot(self.F, self.x)
        self.P = self._alpha_sq * dot(dot(self.F, self.P), self.F.T) + self.Q
        self.x_prior = np.copy(self.x)
        self.P_prior = np.copy(self.P)

    def update(self, z, R, HJacobian, Hx, residual=np.subtract, args=()):
        if z is None:
            self.x_post = self.x.copy()
            self.P_post = self.P.copy()
            return
        H = HJacobian(self.x, *args)
        PHT = dot(self.P, H.T)
        S = dot(H, PHT) + R
        K = dot(PHT, np.linalg.inv(S))
        y = residual(z.reshape(-1, 1), Hx(self.x, *args))
        self.x = self.x + dot(K, y)
        # P = (I-KH)P(I-KH)' + KRK' is more numerically stable than (I-KH)P
        I_KH = self._I - dot(K, H)
        self.P = dot(dot(I_KH, self.P), I_KH.T) + dot(dot(K, R), K.T)
        self.x_post = self.x.copy()
        self.P_post = self.P.copy()


def Q_discrete_white_noise(dt, var):
    """Of px, py, vx, vy."""
    q = np.array([[0.25 * dt**4, 0.5 * dt**3], [0.5 * dt**3, dt**2]]) * var
    return np.kron(q, np.eye(2))


def residual_radar(a, b):
    y = a - b
    y[1, 0] = y[1, 0] % (2 * np.pi)
    if y[1, 0] > np.pi:
        y[1, 0] -= 2 * np.pi
    return y


def relative(x, scan):
    dx, dy = x[0, 0] - scan.sensor_pose[0], x[1, 0] - scan.sensor_pose[1]
    return dx, dy, x[2, 0] - scan.sensor_velocity[0], x[3, 0] - scan.sensor_velocity[1]


def Hx_radar(x, scan):
    dx, dy, vx, vy = relative(x, scan)
    r = max((dx**2 + dy**2) ** 0.5, 1e-3)
    return np.array([[r], [np.arctan2(dy, dx) - scan.sensor_pose[2]], [(dx * vx + dy * vy) / r]])


def HJ_radar(x, scan):
    dx, dy, vx, vy = relative(x, scan)
    r = max((dx**2 + dy**2) ** 0.5, 1e-3)
    cross = vx * dy - vy * dx
    return np.array(
        [
            [dx / r, dy / r, 0.0, 0.0],
            [-dy / r**2, dx / r**2, 0.0, 0.0],
            [dy * cross / r**3, -dx * cross / r**3, dx / r, dy / r],
        ]
    )


def HJ_lidar(_, scan):
    c, s = np.cos(scan.sensor_pose[2]), np.sin(scan.sensor_pose[2])
    return np.array([[c, s, 0.0, 0.0], [-s, c, 0.0, 0.0]])


def Hx_lidar(x, scan):
    dx, dy, _, _ = relative(x, scan)
    return dot(HJ_lidar(x, scan)[:, :2], np.array([[dx], [dy]]))


class Tracker:
    def __init__(self, acceleration_variance=9.0):
        self.var = acceleration_variance
        self.ekf = None
        self.t = None

    def step(self, state, scan):
        if self.ekf is None:
            self.ekf = self.new_filter(scan)
        else:
            dt = scan.time - self.t
            self.ekf.F[0, 2] = self.ekf.F[1, 3] = dt
            self.ekf.Q = Q_discrete_white_noise(dt, self.var)
            self.ekf.predict()
            z = scan.measurement if scan.valid else None
            if scan.kind == "radar":
                self.ekf.update(z, scan.noise_covariance, HJ_radar, Hx_radar, residual_radar, (scan,))
            else:
                self.ekf.update(z, scan.noise_covariance, HJ_lidar, Hx_lidar, args=(scan,))
        self.t = scan.time
        return None, (self.ekf.x_post[:, 0].copy(), self.ekf.P_post.copy())

    def new_filter(self, scan):
        ekf = ExtendedKalmanFilter(4)
        x0, y0, yaw = scan.sensor_pose
        if scan.kind == "radar":
            r, bearing = scan.measurement[0], yaw + scan.measurement[1]
            ekf.x[:2, 0] = x0 + r * np.cos(bearing), y0 + r * np.sin(bearing)
        else:
            zx, zy = scan.measurement
            ekf.x[:2, 0] = x0 + np.cos(yaw) * zx - np.sin(yaw) * zy, y0 + np.sin(yaw) * zx + np.cos(yaw) * zy
        ekf.P = np.diag([2.0, 2.0, 400.0, 400.0])
        ekf.x_post, ekf.P_post = ekf.x.copy(), ekf.P.copy()
        return ekf
