"""A cubature Kalman filter with functions for its angles, and a tracker of x, y, course, speed and turn rate."""

from copy import deepcopy
from math import atan2, cos, hypot, pi, sin

import numpy as np


def plain_mean(points):
    return points.mean(axis=0)


class CubatureKalmanFilter:
    def __init__(self, dim_x, fx, hx, x_mean=plain_mean, residual_x=np.subtract):
        self.dim_x, self.fx, self.hx = dim_x, fx, hx
        self.x_mean, self.residual_x = x_mean, residual_x
        self.x, self.P = np.zeros(dim_x), np.eye(dim_x)

    def points(self):
        U = np.linalg.cholesky(self.P).T * np.sqrt(self.dim_x)
        return np.vstack([self.x + U, self.x - U])

    def predict(self, dt, Q):
        self.sigmas_f = np.array([self.fx(p, dt) for p in self.points()])
        self.x = self.x_mean(self.sigmas_f)
        d = np.array([self.residual_x(p, self.x) for p in self.sigmas_f])
        self.P = d.T @ d / len(d) + Q

    def update(self, z, R, scan, z_mean=plain_mean, residual_z=np.subtract):
        sigmas = self.points()
        sigmas_h = np.array([self.hx(p, scan) for p in sigmas])
        zp = z_mean(sigmas_h)
        dz = np.array([residual_z(h, zp) for h in sigmas_h])
        dx = np.array([self.residual_x(p, self.x) for p in sigmas])
        S = dz.T @ dz / len(dz) + R
        K = dx.T @ dz / len(dz) @ np.linalg.inv(S)
        self.x = self.x + K @ residual_z(z, zp)
        self.P = self.P - K @ S @ K.T
        self.P = (self.P + self.P.T) / 2


def wrap(a):
    return (a + pi) % (2 * pi) - pi


def fx(p, dt):
    x, y, course, speed, turn = p
    half = course + turn * dt / 2
    return np.array([x + speed * dt * cos(half), y + speed * dt * sin(half), wrap(course + turn * dt), speed, turn])


def state_mean(points):
    mean = points.mean(axis=0)
    mean[2] = atan2(np.sin(points[:, 2]).mean(), np.cos(points[:, 2]).mean())
    return mean


def state_residual(a, b):
    d = np.subtract(a, b)
    d[2] = wrap(d[2])
    return d


def hx(p, scan):
    ex, ey, yaw = scan.sensor_pose
    dx, dy = p[0] - ex, p[1] - ey
    if scan.kind == "lidar":
        return np.array([cos(yaw) * dx + sin(yaw) * dy, cos(yaw) * dy - sin(yaw) * dx])
    r = hypot(dx, dy)
    ux = p[3] * cos(p[2]) - scan.sensor_velocity[0]
    uy = p[3] * sin(p[2]) - scan.sensor_velocity[1]
    return np.array([r, wrap(atan2(dy, dx) - yaw), (dx * ux + dy * uy) / r])


def radar_mean(points):
    mean = points.mean(axis=0)
    mean[1] = atan2(np.sin(points[:, 1]).mean(), np.cos(points[:, 1]).mean())
    return mean


def radar_residual(a, b):
    d = np.subtract(a, b)
    d[1] = wrap(d[1])
    return d


class WarmUp:
    """A linear filter of positions until the course is known."""

    def __init__(self, z, R):
        self.m = np.array([*z, 0.0, 0.0])
        self.C = np.diag([0.0, 0.0, 300.0, 300.0])
        self.C[:2, :2] = R
        self.used = 1

    def predict(self, dt):
        F = np.eye(4) + dt * np.eye(4, k=2)
        G = 3.0 * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        self.m, self.C = F @ self.m, F @ self.C @ F.T + G @ G.T

    def update(self, z, R):
        K = self.C[:, :2] @ np.linalg.inv(self.C[:2, :2] + R)
        self.m = self.m + K @ (z - self.m[:2])
        self.C = self.C - K @ self.C[:2]
        self.C = (self.C + self.C.T) / 2
        self.used += 1

    def ready(self):
        return self.used >= 12 and hypot(self.m[2], self.m[3]) > 2.0

    def convert(self):
        vx, vy = self.m[2:]
        v = hypot(vx, vy)
        ckf = CubatureKalmanFilter(5, fx, hx, x_mean=state_mean, residual_x=state_residual)
        ckf.x = np.array([self.m[0], self.m[1], atan2(vy, vx), v, 0.0])
        T = np.zeros((5, 4))
        T[0, 0] = T[1, 1] = 1.0
        T[2, 2:], T[3, 2:] = [-vy / v**2, vx / v**2], [vx / v, vy / v]
        ckf.P = T @ self.C @ T.T
        ckf.P[4, 4] = 0.3**2
        return ckf


def process_noise(x, dt, accel=2.5, twist=1.2):
    g = np.array([dt**2 / 2 * cos(x[2]), dt**2 / 2 * sin(x[2]), 0.0, dt, 0.0]) * accel
    w = np.array([-(dt**2) / 2 * sin(x[2]), dt**2 / 2 * cos(x[2]), dt**2 / 2, 0.0, dt]) * twist
    return np.outer(g, g) + np.outer(w, w) + 1e-9 * np.eye(5)


def position(scan):
    radar = scan.kind == "radar"
    r, a = (scan.measurement[0], scan.sensor_pose[2] + scan.measurement[1]) if radar else (1.0, scan.sensor_pose[2])
    J = np.array([[cos(a), -r * sin(a)], [sin(a), r * cos(a)]])
    local = np.array([r, 0.0]) if radar else scan.measurement
    return scan.sensor_pose[:2] + J @ local, J @ scan.noise_covariance[:2, :2] @ J.T


class Tracker:
    def step(self, state, scan):
        if state is None:
            f = WarmUp(*position(scan))
        else:
            f = deepcopy(state[1])
            dt = scan.time - state[0]
            if isinstance(f, WarmUp):
                f.predict(dt)
                if scan.valid:
                    f.update(*position(scan))
                if f.ready():
                    f = f.convert()
            else:
                f.predict(dt, process_noise(f.x, dt))
                if scan.valid and scan.kind == "radar":
                    f.update(scan.measurement, scan.noise_covariance, scan, radar_mean, radar_residual)
                elif scan.valid:
                    f.update(scan.measurement, scan.noise_covariance, scan)
        return (scan.time, f), self.estimate(f)

    def estimate(self, f):
        if isinstance(f, WarmUp):
            return f.m, f.C
        x, y, course, speed, _ = f.x
        T = np.zeros((4, 5))
        T[0, 0] = T[1, 1] = 1.0
        T[2, 2:4], T[3, 2:4] = [-speed * sin(course), cos(course)], [speed * cos(course), sin(course)]
        P = T @ f.P @ T.T + 1e-6 * np.eye(4)
        return np.array([x, y, speed * cos(course), speed * sin(course)]), (P + P.T) / 2
