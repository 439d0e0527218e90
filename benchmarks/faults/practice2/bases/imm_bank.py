"""An interacting multiple model filter: cruising, and manoeuvring with an acceleration in the state."""

import copy
from math import atan2, cos, hypot, pi, sin

import numpy as np


class Mode:
    """One filter of the bank; its state is px, py, vx, vy, ax, ay."""

    def __init__(self, keep, accel_var, jerk_var):
        self.keep = keep  # whether the acceleration lasts
        self.accel_var, self.jerk_var = accel_var, jerk_var
        self.x = np.zeros(6)
        self.P = np.eye(6)
        self.likelihood = 1.0

    def predict(self, dt):
        F = np.eye(6)
        F[:2, 2:4] = dt * np.eye(2)
        F[:2, 4:] = self.keep * dt**2 / 2 * np.eye(2)
        F[2:4, 4:] = self.keep * dt * np.eye(2)
        F[4:, 4:] = self.keep * np.eye(2)
        g = np.array([dt**2 / 2, dt, 1.0])
        variance = self.jerk_var * dt**2 if self.keep else self.accel_var
        small = variance * np.outer(g, g)
        self.x = F @ self.x
        self.P = F @ self.P @ F.T + np.kron(small, np.eye(2))

    def update(self, y, H, R):
        S = H @ self.P @ H.T + R
        SI = np.linalg.inv(S)
        K = self.P @ H.T @ SI
        self.x = self.x + K @ y
        A = np.eye(6) - K @ H
        self.P = A @ self.P @ A.T + K @ R @ K.T
        self.likelihood = np.exp(-0.5 * y @ SI @ y) / np.sqrt(np.linalg.det(2 * pi * S))


def expectation(x, scan):
    ex, ey, yaw = scan.sensor_pose
    dx, dy = x[0] - ex, x[1] - ey
    if scan.kind == "lidar":
        M = np.array([[cos(yaw), sin(yaw)], [-sin(yaw), cos(yaw)]])
        return M @ [dx, dy], np.hstack([M, np.zeros((2, 4))])
    ux, uy = x[2:4] - scan.sensor_velocity
    r = hypot(dx, dy)
    c, s = dx / r, dy / r
    turn = (c * uy - s * ux) / r
    H = np.array([[c, s, 0, 0, 0, 0], [-s / r, c / r, 0, 0, 0, 0], [-s * turn, c * turn, c, s, 0, 0]])
    return np.array([r, atan2(dy, dx) - yaw, c * ux + s * uy]), H


def innovation(x, scan):
    h, H = expectation(x, scan)
    y = scan.measurement - h
    if scan.kind == "radar":
        y[1] = (y[1] + pi) % (2 * pi) - pi
    return y, H


class Bank:
    def __init__(self, modes, M):
        self.modes = modes
        self.M = np.array(M)  # from the row's mode to the column's, in 0.1 s
        self.mu = np.full(len(modes), 1 / len(modes))
        self.time = None

    def transition(self, dt):
        """For another time."""
        part = min(abs(dt) / 0.1, 1.0)
        return np.eye(len(self.modes)) + part * (self.M - np.eye(len(self.modes)))

    def interact(self, dt):
        joint = self.transition(dt) * self.mu[:, None]
        cbar = joint.sum(axis=0)
        omega = joint / cbar
        xs = [mode.x for mode in self.modes]
        Ps = [mode.P for mode in self.modes]
        for j, mode in enumerate(self.modes):
            mixed = sum(w * x for w, x in zip(omega[:, j], xs, strict=True))
            P = np.zeros((6, 6))
            for w, x, Pi in zip(omega[:, j], xs, Ps, strict=True):
                d = x - mixed
                P += w * (Pi + np.outer(d, d))
            mode.x, mode.P = mixed, P
        self.mu = cbar

    def predict(self, time):
        dt = time - self.time
        self.time = time
        self.interact(dt)
        for mode in self.modes:
            mode.predict(dt)

    def update(self, scan):
        for mode in self.modes:
            y, H = innovation(mode.x, scan)
            mode.update(y, H, scan.noise_covariance)
        mu = self.mu * [mode.likelihood for mode in self.modes] + 1e-300
        self.mu = mu / mu.sum()

    def start(self, scan):
        self.time = scan.time
        ex, ey, yaw = scan.sensor_pose
        z, R = scan.measurement, scan.noise_covariance[:2, :2]
        if scan.kind == "radar":
            c, s = cos(yaw + z[1]), sin(yaw + z[1])
            place = [ex + z[0] * c, ey + z[0] * s]
            J = np.array([[c, -z[0] * s], [s, z[0] * c]])
        else:
            J = np.array([[cos(yaw), -sin(yaw)], [sin(yaw), cos(yaw)]])
            place = [ex, ey] + J @ z
        for mode in self.modes:
            mode.x = np.array([*place, 0.0, 0.0, 0.0, 0.0])
            mode.P = np.diag([0.0, 0.0, 400.0, 400.0, 4.0, 4.0])
            mode.P[:2, :2] = J @ R @ J.T

    def combined(self):
        x = sum(w * mode.x for w, mode in zip(self.mu, self.modes, strict=True))
        P = np.zeros((6, 6))
        for w, mode in zip(self.mu, self.modes, strict=True):
            d = mode.x - x
            P += w * (mode.P + np.outer(d, d))
        return x[:4], P[:4, :4]


class Tracker:
    def step(self, state, scan):
        if state is None:
            bank = Bank([Mode(0.0, 0.3, 0.0), Mode(1.0, 0.0, 16.0)], [[0.98, 0.02], [0.15, 0.85]])
            bank.start(scan)
        else:
            bank = copy.deepcopy(state)
            bank.predict(scan.time)
            if scan.valid:
                bank.update(scan)
        return bank, bank.combined()
