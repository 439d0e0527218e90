"""A Kalman filter on measurements converted to the fixed frame, one component after the other, with a gate."""

import numpy as np
from scipy.stats import chi2

N = 4  # px, py, vx, vy


class Tracker:
    def __init__(self, acceleration_sigma=3.0, gate=0.9999, patience=3):
        self.q = acceleration_sigma**2
        self.limits = {m: chi2.ppf(gate, m) for m in (2, 3)}  # by the degrees of freedom
        self.patience = patience
        self.x = None
        self.P = None
        self.Q = np.zeros((N, N))
        self.time = None
        self.first = None  # time, position and covariance of the first measurement
        self.rejected = 0

    def step(self, state, scan):
        if self.x is None:
            self.start(scan)
        else:
            dt = scan.time - self.time
            self.time = scan.time
            self.predict(dt)
            if scan.valid:
                self.update(scan)
        if self.x is None:
            return None, None
        return None, (self.x.copy(), self.P.copy())

    def start(self, scan):
        """A velocity from the first two measurements of different times."""
        if not scan.valid:
            return
        z, _, R = self.converted(scan)
        if self.first is None:
            self.first = scan.time, z[:2], R[:2, :2]
            return
        t, z1, R1 = self.first
        dt = scan.time - t
        if dt <= 0:
            return
        R2 = R[:2, :2]
        self.x = np.concatenate([z[:2], (z[:2] - z1) / dt])
        self.P = np.zeros((N, N))
        self.P[:2, :2] = R2
        self.P[:2, 2:] = self.P[2:, :2] = R2 / dt
        self.P[2:, 2:] = (R1 + R2) / dt**2
        self.time = scan.time

    def process_noise(self, dt):
        Q = np.zeros((N, N))
        for i in range(2):
            Q[i, i] = self.q * dt**3 / 3
            Q[i, i + 2] = Q[i + 2, i] = self.q * dt**2 / 2
            Q[i + 2, i + 2] = self.q * dt
        return Q

    def predict(self, dt):
        F = np.eye(N)
        F[0, 2] = dt
        F[1, 3] = dt
        self.Q = self.process_noise(dt)
        self.x = F @ self.x
        self.P = F @ self.P @ F.T + self.Q

    def converted(self, scan):
        """z, H and R of the position in the fixed frame, and of a radar the speed along the line of sight."""
        x, y, yaw = scan.sensor_pose
        if scan.kind == "lidar":
            T = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            return np.array([x, y]) + T @ scan.measurement, np.eye(2, N), T @ scan.noise_covariance @ T.T
        r, azimuth, rate = scan.measurement
        c, s = np.cos(yaw + azimuth), np.sin(yaw + azimuth)
        z = np.array([x + r * c, y + r * s, rate + c * scan.sensor_velocity[0] + s * scan.sensor_velocity[1]])
        J = np.array([[c, -r * s, 0.0], [s, r * c, 0.0], [0.0, 0.0, 1.0]])
        if self.x is not None:  # an error of the azimuth turns the line of sight of the relative velocity
            J[2, 1] = s * (self.x[2] - scan.sensor_velocity[0]) - c * (self.x[3] - scan.sensor_velocity[1])
        H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, c, s]])
        return z, H, J @ scan.noise_covariance @ J.T

    def update(self, scan):
        z, H, R = self.converted(scan)
        y = z - H @ self.x
        S = H @ self.P @ H.T + R
        if y @ np.linalg.solve(S, y) > self.limits[len(y)] and self.rejected < self.patience:
            self.rejected += 1
            return
        self.rejected = 0
        # Components whose noise is independent, so that each is a scalar measurement.
        L = np.linalg.cholesky(R)
        for value, h in zip(np.linalg.solve(L, z), np.linalg.solve(L, H), strict=True):
            self.update_scalar(value, h)

    def update_scalar(self, value, h):
        Ph = self.P @ h
        s = h @ Ph + 1.0
        k = Ph / s
        self.x = self.x + k * (value - h @ self.x)
        P = self.P.copy()
        for i in range(N):
            for j in range(N):
                P[i, j] = self.P[i, j] - k[i] * Ph[j]
        self.P = (P + P.T) / 2
