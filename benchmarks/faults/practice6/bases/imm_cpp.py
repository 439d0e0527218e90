"""Translated from a course's C++: a model of constant velocity and one of constant acceleration, and an IMM of both."""

import math

import numpy as np

NX = 6  # px, py, vx, vy, ax, ay


class KFBase:
    def __init__(self):
        self.x_ = np.zeros(NX)
        self.P_ = np.eye(NX)
        self.F_ = np.eye(NX)
        self.Q_ = np.zeros((NX, NX))
        self.likelihood_ = 1.0
        self.dt_ = 0.0

    def Init(self, x, P):
        self.x_ = x.copy()
        self.P_ = P.copy()

    def SetTimeStep(self, dt):
        self.dt_ = dt
        self.UpdateF()
        self.UpdateQ()

    def Predict(self):
        self.x_ = self.F_ @ self.x_
        self.P_ = self.F_ @ self.P_ @ self.F_.T + self.Q_

    def MeasurementUpdate(self, z, H, R):
        residual = z - H @ self.x_
        S = H @ self.P_ @ H.T + R
        Si = np.linalg.inv(S)
        K = self.P_ @ H.T @ Si
        self.x_ = self.x_ + K @ residual
        I_KH = np.eye(NX) - K @ H
        self.P_ = I_KH @ self.P_ @ I_KH.T + K @ R @ K.T
        norm = math.sqrt((2.0 * math.pi) ** len(z) * np.linalg.det(S))
        self.likelihood_ = math.exp(-0.5 * residual @ Si @ residual) / norm


class CV(KFBase):
    """The acceleration is about zero at all times."""

    def UpdateF(self):
        self.F_ = np.diag([1.0, 1.0, 1.0, 1.0, 0.0, 0.0])
        self.F_[0, 2] = self.F_[1, 3] = self.dt_

    def UpdateQ(self):
        t, q = self.dt_, 0.1
        self.Q_ = np.zeros((NX, NX))
        for k in (0, 1):
            self.Q_[k, k] = q * t**3 / 3.0
            self.Q_[k, k + 2] = self.Q_[k + 2, k] = q * t**2 / 2.0
            self.Q_[k + 2, k + 2] = q * t
            self.Q_[k + 4, k + 4] = 1.0


class CA(KFBase):
    def UpdateF(self):
        t = self.dt_
        self.F_ = np.eye(NX)
        for k in range(4):
            self.F_[k, k + 2] = t
        self.F_[0, 4] = self.F_[1, 5] = 0.5 * t * t

    def UpdateQ(self):
        t, q = self.dt_, 8.0
        block = q * np.array([
            [t**5 / 20.0, t**4 / 8.0, t**3 / 6.0],
            [t**4 / 8.0, t**3 / 3.0, t**2 / 2.0],
            [t**3 / 6.0, t**2 / 2.0, t],
        ])  # fmt: skip
        self.Q_ = np.zeros((NX, NX))
        self.Q_[0::2, 0::2] = block
        self.Q_[1::2, 1::2] = block


class IMM:
    def __init__(self, models, transfer_prob, model_prob):
        self.models_ = models
        self.transfer_prob_ = np.array(transfer_prob)  # from the row's model to the column's
        self.U_ = np.array(model_prob)
        self.c_ = self.U_.copy()
        self.x_ = models[0].x_
        self.P_ = models[0].P_

    def InputInteract(self):
        n = len(self.models_)
        self.c_ = np.zeros(n)
        for j in range(n):
            for i in range(n):
                self.c_[j] += self.transfer_prob_[i, j] * self.U_[i]
        X, P = [], []
        for j in range(n):
            mix = self.transfer_prob_[:, j] * self.U_ / self.c_[j]
            Xj = np.zeros(NX)
            for i in range(n):
                Xj += mix[i] * self.models_[i].x_
            Pj = np.zeros((NX, NX))
            for i in range(n):
                s = self.models_[i].x_ - Xj
                Pj += mix[i] * (self.models_[i].P_ + np.outer(s, s))
            X.append(Xj)
            P.append(Pj)
        for j in range(n):
            self.models_[j].x_ = X[j]
            self.models_[j].P_ = P[j]

    def PredictState(self, dt):
        for model in self.models_:
            model.SetTimeStep(dt)
            model.Predict()
        self.U_ = self.c_.copy()

    def UpdateModelProb(self, z, H, R):
        for j, model in enumerate(self.models_):
            model.MeasurementUpdate(z, H, R)
            self.U_[j] = self.c_[j] * (model.likelihood_ + 1e-100)
        self.U_ = self.U_ / np.sum(self.U_)

    def EstimateFusion(self):
        self.x_ = np.zeros(NX)
        for j, model in enumerate(self.models_):
            self.x_ = self.x_ + self.U_[j] * model.x_
        self.P_ = np.zeros((NX, NX))
        for j, model in enumerate(self.models_):
            s = model.x_ - self.x_
            self.P_ = self.P_ + self.U_[j] * (model.P_ + np.outer(s, s))


def CartesianMeasurement(scan):
    """z, H and R in the world's axes."""
    x0, y0, yaw = scan.sensor_pose
    m, R = scan.measurement, scan.noise_covariance
    if scan.kind == "radar":
        c, s = math.cos(yaw + m[1]), math.sin(yaw + m[1])
        J = np.array([[c, -m[0] * s, 0.0], [s, m[0] * c, 0.0], [0.0, 0.0, 1.0]])
        ground = m[2] + c * scan.sensor_velocity[0] + s * scan.sensor_velocity[1]
        z = np.array([x0 + m[0] * c, y0 + m[0] * s, ground])
        H = np.zeros((3, NX))
        H[0, 0] = H[1, 1] = 1.0
        H[2, 2], H[2, 3] = c, s
        R = J @ R @ J.T
        R[2, 2] += 0.02
        return z, H, R
    c, s = math.cos(yaw), math.sin(yaw)
    J = np.array([[c, -s], [s, c]])
    return np.array([x0, y0]) + J @ m, np.eye(2, NX), J @ R @ J.T


class Tracker:
    def __init__(self):
        self.imm_ = None
        self.time_ = 0.0

    def step(self, state, scan):
        if self.imm_ is None:
            z, _, R = CartesianMeasurement(scan)
            x = np.zeros(NX)
            x[:2] = z[:2]
            P = np.diag([0.0, 0.0, 400.0, 400.0, 4.0, 4.0])
            P[:2, :2] = R[:2, :2]
            models = [CV(), CA()]
            for model in models:
                model.Init(x, P)
            self.imm_ = IMM(models, [[0.96, 0.04], [0.04, 0.96]], [0.5, 0.5])
        else:
            self.imm_.InputInteract()
            self.imm_.PredictState(scan.time - self.time_)
            if scan.valid:
                self.imm_.UpdateModelProb(*CartesianMeasurement(scan))
        self.imm_.EstimateFusion()
        self.time_ = scan.time
        return None, (self.imm_.x_[:4], 0.5 * (self.imm_.P_ + self.imm_.P_.T)[:4, :4])
