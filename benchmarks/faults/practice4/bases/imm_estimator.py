"""An IMM estimator over filter objects, as libraries have it: predict(), update(z), x, P, mu, M, cbar, omega."""

from copy import deepcopy

import numpy as np
from numpy import dot, outer, zeros
from scipy.stats import multivariate_normal


class KalmanFilter:
    def __init__(self, dim_x):
        self.x = zeros((dim_x, 1))
        self.P = np.eye(dim_x)
        self.Q = np.eye(dim_x)
        self.F = np.eye(dim_x)
        self.likelihood = 1.0

    def predict(self):
        self.x = dot(self.F, self.x)
        self.P = dot(self.F, self.P).dot(self.F.T) + self.Q

    def update(self, z, R, H):
        y = z - dot(H, self.x)
        PHT = dot(self.P, H.T)
        S = dot(H, PHT) + R
        K = dot(PHT, np.linalg.inv(S))
        self.x = self.x + dot(K, y)
        I_KH = np.eye(len(self.x)) - dot(K, H)
        self.P = dot(I_KH, self.P).dot(I_KH.T) + dot(K, R).dot(K.T)
        self.likelihood = multivariate_normal.pdf(y.ravel(), cov=S) + 1e-300


class IMMEstimator:
    """M[i, j] is the probability of going from filter i to filter j."""

    def __init__(self, filters, mu, M):
        self.filters = filters
        self.mu = np.array(mu, dtype=float)
        self.M = np.array(M, dtype=float)
        self.N = len(filters)
        self.x = filters[0].x.copy()
        self.P = filters[0].P.copy()
        self._compute_mixing_probabilities()
        self._compute_state_estimate()

    def predict(self):
        xs, Ps = [], []
        for w in self.omega.T:
            x = zeros(self.x.shape)
            for kf, wj in zip(self.filters, w, strict=True):
                x = x + kf.x * wj
            xs.append(x)
            P = zeros(self.P.shape)
            for kf, wj in zip(self.filters, w, strict=True):
                y = kf.x - x
                P = P + wj * (outer(y, y) + kf.P)
            Ps.append(P)
        for i, f in enumerate(self.filters):
            f.x, f.P = xs[i], Ps[i]
            f.predict()
        self.mu = self.cbar
        self._compute_mixing_probabilities()
        self._compute_state_estimate()

    def update(self, z, R, H):
        for i, f in enumerate(self.filters):
            f.update(z, R, H)
            self.mu[i] = f.likelihood * self.mu[i]
        self.mu /= np.sum(self.mu)
        self._compute_mixing_probabilities()
        self._compute_state_estimate()

    def _compute_mixing_probabilities(self):
        self.cbar = dot(self.mu, self.M)
        self.omega = self.M * self.mu[:, np.newaxis] / self.cbar

    def _compute_state_estimate(self):
        self.x = sum(f.x * mu for f, mu in zip(self.filters, self.mu, strict=True))
        self.P = zeros(self.P.shape)
        for f, mu in zip(self.filters, self.mu, strict=True):
            y = f.x - self.x
            self.P = self.P + mu * (outer(y, y) + f.P)


def kinematics(dt, var):
    """Of px, py, vx, vy."""
    F = np.kron([[1.0, dt], [0.0, 1.0]], np.eye(2))
    Q = np.kron(var * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), np.eye(2))
    return F, Q


def measurement(scan):
    """z as a column, R and H in the fixed frame."""
    z, yaw = scan.measurement, scan.sensor_pose[2]
    radar = scan.kind == "radar"
    a, r = (yaw + z[1], z[0]) if radar else (yaw, 1.0)
    c, s = np.cos(a), np.sin(a)
    J = np.array([[c, -r * s], [s, r * c]])
    place = scan.sensor_pose[:2] + dot(J, [r, 0.0] if radar else z)
    R, H = dot(J, scan.noise_covariance[:2, :2]).dot(J.T), np.eye(2, 4)
    if radar:
        place = np.append(place, z[2] + dot([c, s], scan.sensor_velocity))
        R = np.block([[R, zeros((2, 1))], [zeros((1, 2)), scan.noise_covariance[2:, 2:] + 0.02]])
        H = np.vstack([H, [0.0, 0.0, c, s]])
    return place.reshape(-1, 1), R, H


VARIANCES = (0.25, 4.0)  # (m/s^2)^2 s


class Tracker:
    def step(self, state, scan):
        if state is None:
            z, R, _ = measurement(scan)
            filters = []
            for _ in VARIANCES:
                kf = KalmanFilter(4)
                kf.x[:2] = z[:2]
                kf.P = np.diag([0.0, 0.0, 300.0, 300.0])
                kf.P[:2, :2] = R[:2, :2]
                filters.append(kf)
            imm = IMMEstimator(filters, [0.5, 0.5], [[0.97, 0.03], [0.06, 0.94]])
        else:
            imm = deepcopy(state[1])
            for kf, var in zip(imm.filters, VARIANCES, strict=True):
                kf.F, kf.Q = kinematics(scan.time - state[0], var)
            imm.predict()
            if scan.valid:
                imm.update(*measurement(scan))
        return (scan.time, imm), (imm.x[:, 0], (imm.P + imm.P.T) / 2)
