"""Unscented Kalman filter, written out with matrices whose columns are the sigma points."""

import numpy as np

NX = 4
LAMBDA = 3 - NX + 2.0
WEIGHTS = np.full(2 * NX + 1, 0.5 / (NX + LAMBDA))
WEIGHTS[0] = LAMBDA / (NX + LAMBDA)


def angle(a):
    return np.arctan2(np.sin(a), np.cos(a))


class UKF:
    acceleration = 3.0

    def __init__(self, x, P, t):
        self.x, self.P, self.t = x, P, t

    @classmethod
    def from_first(cls, scan):
        z, R = scan.measurement, scan.noise_covariance
        c, s = np.cos(scan.sensor_pose[2]), np.sin(scan.sensor_pose[2])
        rot = np.array([[c, -s], [s, c]])
        local = z[:2]
        D = np.eye(2)
        if scan.kind == "radar":
            local = z[0] * np.array([np.cos(z[1]), np.sin(z[1])])
            D = np.array([[np.cos(z[1]), -local[1]], [np.sin(z[1]), local[0]]])
        x = np.concatenate([scan.sensor_pose[:2] + rot @ local, [0.0, 0.0]])
        P = np.zeros((NX, NX))
        P[:2, :2] = rot @ D @ R[:2, :2] @ D.T @ rot.T
        P[2:, 2:] = 400.0 * np.eye(2)
        return cls(x, P, scan.time)

    def sigma_points(self):
        A = np.linalg.cholesky((NX + LAMBDA) * self.P)
        Xsig = np.tile(self.x[:, None], (1, 2 * NX + 1))
        for i in range(NX):
            Xsig[:, i + 1] += A[:, i]
            Xsig[:, i + 1 + NX] -= A[:, i]
        return Xsig

    def process(self, Xsig, dt):
        out = Xsig.copy()
        out[0] += Xsig[2] * dt
        out[1] += Xsig[3] * dt
        return out

    def measure(self, Xsig, scan):
        dx = Xsig[0] - scan.sensor_pose[0]
        dy = Xsig[1] - scan.sensor_pose[1]
        yaw = scan.sensor_pose[2]
        if scan.kind != "radar":
            return np.stack([np.cos(yaw) * dx + np.sin(yaw) * dy, np.cos(yaw) * dy - np.sin(yaw) * dx])
        r = np.sqrt(dx**2 + dy**2)
        ux = Xsig[2] - scan.sensor_velocity[0]
        uy = Xsig[3] - scan.sensor_velocity[1]
        return np.stack([r, angle(np.arctan2(dy, dx) - yaw), (dx * ux + dy * uy) / r])

    def predict(self, t):
        dt, self.t = t - self.t, t
        Xpred = self.process(self.sigma_points(), dt)
        self.x = Xpred @ WEIGHTS
        diff = Xpred - self.x[:, None]
        G = np.array([[dt**2 / 2, 0], [0, dt**2 / 2], [dt, 0], [0, dt]])
        self.P = (diff * WEIGHTS) @ diff.T + self.acceleration**2 * G @ G.T

    def update(self, scan):
        Xsig = self.sigma_points()
        Zsig = self.measure(Xsig, scan)
        radar = scan.kind == "radar"
        # differences from the first point, so that the mean of the azimuths is right across pi
        offset = Zsig - Zsig[:, :1]
        if radar:
            offset[1] = angle(offset[1])
        z_pred = Zsig[:, 0] + offset @ WEIGHTS
        Zdiff = offset - (offset @ WEIGHTS)[:, None]
        Xdiff = Xsig - self.x[:, None]
        S = (Zdiff * WEIGHTS) @ Zdiff.T + scan.noise_covariance
        T = (Xdiff * WEIGHTS) @ Zdiff.T
        K = T @ np.linalg.inv(S)
        y = scan.measurement - z_pred
        if radar:
            y[1] = angle(y[1])
        self.x = self.x + K @ y
        self.P = (Xdiff * WEIGHTS) @ Xdiff.T - K @ S @ K.T
        self.P = (self.P + self.P.T) / 2


class Tracker:
    def step(self, state, scan):
        if state is None:
            ukf = UKF.from_first(scan)
        else:
            ukf = UKF(*state)
            ukf.predict(scan.time)
            if scan.valid:
                ukf.update(scan)
        return (ukf.x, ukf.P, ukf.t), (ukf.x, ukf.P)
