"""A small extended Kalman filter: an abstract class does the matrices, a subclass says what the models are."""

from abc import ABC, abstractmethod
from math import atan2, cos, fmod, hypot, pi, sin

import numpy as np


def wrap_angle(angle):
    angle = fmod(angle, 2.0 * pi)
    if angle > pi:
        angle = angle - 2.0 * pi
    elif angle < -pi:
        angle = angle + 2.0 * pi
    return angle


class EKF(ABC):
    def __init__(self, x, P):
        self.x = x
        self.P_pre = P
        self.P_post = P

    @abstractmethod
    def f(self, x):
        """The predicted state and the Jacobian."""

    @abstractmethod
    def h(self, x):
        """The predicted observation and the Jacobian."""

    @abstractmethod
    def getQ(self):
        """Covariance of the process noise."""

    def predict(self):
        self.x, F = self.f(self.x)
        self.P_pre = np.dot(F, self.P_post).dot(F.T) + self.getQ()
        self.P_post = self.P_pre

    def correct(self, z, R, angle=None, limit=36.0):
        hx, H = self.h(self.x)
        S = np.dot(H, self.P_pre).dot(H.T) + R
        S_inv = np.linalg.inv(S)
        y = z - hx
        if angle is not None:
            y[angle] = wrap_angle(y[angle])
        if np.dot(y, S_inv).dot(y) > limit:
            return
        G = np.dot(self.P_pre, H.T).dot(S_inv)
        self.x = self.x + np.dot(G, y)
        self.P_post = np.dot(np.eye(len(self.x)) - np.dot(G, H), self.P_pre)
        self.P_post = 0.5 * (self.P_post + self.P_post.T)


class VehicleEKF(EKF):
    """px, py, vx, vy."""

    def __init__(self, x, P, time, accel=3.0):
        super().__init__(x, P)
        self.time = time
        self.dt = 0.0
        self.accel = accel
        self.scan = None

    def f(self, x):
        F = np.eye(4)
        F[0, 2] = F[1, 3] = self.dt
        return np.dot(F, x), F

    def getQ(self):
        dt = self.dt
        G = np.array([[dt * dt / 2, 0], [0, dt * dt / 2], [dt, 0], [0, dt]])
        return self.accel**2 * np.dot(G, G.T)

    def h(self, x):
        ex, ey, yaw = self.scan.sensor_pose
        dx, dy = x[0] - ex, x[1] - ey
        if self.scan.kind == "lidar":
            c, s = cos(yaw), sin(yaw)
            H = np.array([[c, s, 0, 0], [-s, c, 0, 0]])
            return np.array([c * dx + s * dy, -s * dx + c * dy]), H
        evx, evy = self.scan.sensor_velocity
        vx, vy = x[2] - evx, x[3] - evy
        r = max(hypot(dx, dy), 1e-3)
        rate = (dx * vx + dy * vy) / r
        H = np.zeros((3, 4))
        H[0, :2] = dx / r, dy / r
        H[1, :2] = -dy / r**2, dx / r**2
        H[2] = (vx - rate * dx / r) / r, (vy - rate * dy / r) / r, dx / r, dy / r
        return np.array([r, atan2(dy, dx) - yaw, rate]), H

    def step(self, scan):
        self.scan = scan
        self.dt = scan.time - self.time
        self.time = scan.time
        self.predict()
        if scan.valid:
            z = np.array(scan.measurement)
            self.correct(z, scan.noise_covariance, angle=1 if scan.kind == "radar" else None)


def first_state(scan):
    ex, ey, yaw = scan.sensor_pose
    z, R = scan.measurement, scan.noise_covariance
    if scan.kind == "radar":
        c, s = cos(yaw + z[1]), sin(yaw + z[1])
        J = np.array([[c, -z[0] * s], [s, z[0] * c]])
        px, py = ex + z[0] * c, ey + z[0] * s
    else:
        c, s = cos(yaw), sin(yaw)
        J = np.array([[c, -s], [s, c]])
        px, py = ex + c * z[0] - s * z[1], ey + s * z[0] + c * z[1]
    P = np.diag([0.0, 0.0, 400.0, 400.0])
    P[:2, :2] = J.dot(R[:2, :2]).dot(J.T)
    return np.array([px, py, 0.0, 0.0]), P


class Tracker:
    def step(self, state, scan):
        if state is None:
            ekf = VehicleEKF(*first_state(scan), scan.time)
        else:
            ekf = VehicleEKF(state.x, state.P_post, state.time)
            ekf.step(scan)
        return ekf, (ekf.x, 0.5 * (ekf.P_post + ekf.P_post.T))
