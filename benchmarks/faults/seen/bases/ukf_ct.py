"""An unscented Kalman filter for a coordinated turn: px, py, vx, vy, turn rate; additive noise, scaled sigma points."""

import numpy as np
from scipy.linalg import cholesky


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


class SigmaPoints:
    """2 n + 1 points (van der Merwe 2004), as rows."""

    def __init__(self, n, alpha=0.5, beta=2.0, kappa=0.0):
        self.n = n
        self.spread = alpha**2 * (n + kappa)
        lambda_ = self.spread - n
        self.Wm = np.full(2 * n + 1, 1 / (2 * self.spread))
        self.Wc = self.Wm.copy()
        self.Wm[0] = lambda_ / self.spread
        self.Wc[0] = lambda_ / self.spread + 1 - alpha**2 + beta

    def draw(self, x, P):
        U = cholesky(self.spread * P)
        return np.vstack([x, x + U, x - U])


class Tracker:
    def __init__(self, acceleration_sigma=2.0, turn_sigma=0.3):
        self.acceleration_sigma = acceleration_sigma
        self.turn_sigma = turn_sigma
        self.points = SigmaPoints(5)
        self.Q = self.process_noise(0.1)

    def step(self, state, scan):
        if state is None:
            x, P = self.first(scan)
        else:
            time, x, P = state
            x, P = self.predict(x, P, scan.time - time)
            if scan.valid:
                x, P = self.update(x, P, scan)
        return (scan.time, x, P), self.estimate(x, P)

    def estimate(self, x, P):
        return x[:4].copy(), P[:4, :4].copy()

    def first(self, scan):
        yaw = scan.sensor_pose[2]
        z, R = scan.measurement, scan.noise_covariance
        if scan.kind == "radar":
            c, s = np.cos(yaw + z[1]), np.sin(yaw + z[1])
            J = np.array([[c, -z[0] * s], [s, z[0] * c]])
            offset = z[0] * np.array([c, s])
        else:
            c, s = np.cos(yaw), np.sin(yaw)
            J = np.array([[c, -s], [s, c]])
            offset = J @ z
        P = np.diag([0.0, 0.0, 400.0, 400.0, 0.1])
        P[:2, :2] = J @ R[:2, :2] @ J.T
        return np.concatenate([scan.sensor_pose[:2] + offset, np.zeros(3)]), P

    def move(self, points, dt):
        px, py, vx, vy, w = points.T
        a = np.sinc(w * dt / np.pi) * dt  # sin(w dt) / w
        b = np.sin(w * dt / 2) * np.sinc(w * dt / 2 / np.pi) * dt  # (1 - cos(w dt)) / w
        c, s = np.cos(w * dt), np.sin(w * dt)
        return np.column_stack([px + a * vx - b * vy, py + b * vx + a * vy, c * vx - s * vy, s * vx + c * vy, w])

    def process_noise(self, dt):
        Q = np.zeros((5, 5))
        for i in (0, 1):
            Q[i, i] = dt**4 / 4
            Q[i, i + 2] = Q[i + 2, i] = dt**3 / 2
            Q[i + 2, i + 2] = dt**2
        Q *= self.acceleration_sigma**2
        Q[4, 4] = self.turn_sigma**2 * dt
        return Q + 1e-8 * np.eye(5)

    def predict(self, x, P, dt):
        self.Q = self.process_noise(dt)
        moved = self.move(self.points.draw(x, P), dt)
        x_moved = self.points.Wm @ moved
        d = moved - x_moved
        return x_moved, d.T @ (self.points.Wc[:, None] * d) + self.Q

    def measure(self, points, scan):
        d = points[:, :2] - scan.sensor_pose[:2]
        yaw = scan.sensor_pose[2]
        if scan.kind == "lidar":
            c, s = np.cos(yaw), np.sin(yaw)
            return np.column_stack([c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]])
        r = np.maximum(np.hypot(d[:, 0], d[:, 1]), 1e-3)
        v = points[:, 2:4] - scan.sensor_velocity
        return np.column_stack([r, np.arctan2(d[:, 1], d[:, 0]) - yaw, (d * v).sum(axis=1) / r])

    def residual(self, a, b, scan):
        y = a - b
        if scan.kind == "radar":
            y[..., 1] = wrap(y[..., 1])
        return y

    def update(self, x, P, scan):
        sigmas = self.points.draw(x, P)
        Z = self.measure(sigmas, scan)
        # Averaged as differences from the central point: the azimuth may pass pi.
        z = Z[0] + self.points.Wm @ self.residual(Z, Z[0], scan)
        dz = self.residual(Z, z, scan)
        dx = sigmas - x
        S = dz.T @ (self.points.Wc[:, None] * dz) + scan.noise_covariance
        K = dx.T @ (self.points.Wc[:, None] * dz) @ np.linalg.inv(S)
        P = P - K @ S @ K.T
        return x + K @ self.residual(scan.measurement, z, scan), (P + P.T) / 2
