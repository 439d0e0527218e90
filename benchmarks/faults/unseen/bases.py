"""Sound trackers, of which the others are made."""

import numpy as np


def wrap(a):
    return (a + np.pi) % (2 * np.pi) - np.pi


def rot(yaw):
    return np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])


def where(scan):
    T, z, R = rot(scan.sensor_pose[2]), scan.measurement, scan.noise_covariance
    if scan.kind == "radar":
        c, s = np.cos(z[1]), np.sin(z[1])
        J = np.array([[c, -z[0] * s], [s, z[0] * c]])
        z, R = z[0] * np.array([c, s]), J @ R[:2, :2] @ J.T
    return scan.sensor_pose[:2] + T @ z, T @ R @ T.T


def first(scan, v_sigma=20.0):
    z, R = where(scan)
    P = np.diag([0, 0, v_sigma**2, v_sigma**2])
    P[:2, :2] = R
    return np.array([*z, 0.0, 0.0]), P


def seen(x, scan):
    d = x[:2] - scan.sensor_pose[:2]
    if scan.kind != "radar":
        return rot(scan.sensor_pose[2]).T @ d
    r = max(np.hypot(*d), 1e-3)
    return np.array([r, wrap(np.arctan2(d[1], d[0]) - scan.sensor_pose[2]), d @ (x[2:4] - scan.sensor_velocity) / r])


def slope(x, scan):
    if scan.kind != "radar":
        return np.hstack([rot(scan.sensor_pose[2]).T, np.zeros((2, 2))])
    (dx, dy), (ux, uy) = x[:2] - scan.sensor_pose[:2], x[2:4] - scan.sensor_velocity
    r = max(np.hypot(dx, dy), 1e-3)
    c, s, w = dx / r, dy / r, (dx * uy - dy * ux) / r**2
    return np.array([[c, s, 0, 0], [-s / r, c / r, 0, 0], [-s * w, c * w, c, s]])


class Ekf:
    sigma = 3.0

    def start(self, scan):
        return first(scan)

    def F(self, dt):
        return np.eye(4) + dt * np.eye(4, k=2)

    def Q(self, dt):
        G = self.sigma * np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        return G @ G.T

    def h(self, x, scan):
        return seen(x, scan)

    def H(self, x, scan):
        return slope(x, scan)

    def R(self, scan):
        return scan.noise_covariance

    def residual(self, scan, expected):
        y = scan.measurement - expected
        if scan.kind == "radar":
            y[1] = wrap(y[1])
        return y

    def predict(self, x, P, dt):
        F = self.F(dt)
        return F @ x, F @ P @ F.T + self.Q(dt)

    def update(self, x, P, scan):
        H, R = self.H(x, scan), self.R(scan)
        if H.shape[1] < len(x):
            H = np.hstack([H, np.zeros((len(H), len(x) - H.shape[1]))])
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        A = np.eye(len(x)) - K @ H
        return x + K @ self.residual(scan, self.h(x, scan)), A @ P @ A.T + K @ R @ K.T

    def step(self, state, scan):
        if state is None:
            x, P = self.start(scan)
        else:
            t, x, P = state
            x, P = self.predict(x, P, scan.time - t)
            if scan.valid:
                x, P = self.update(x, P, scan)
        return (scan.time, x, P), (x[:4], (P[:4, :4] + P[:4, :4].T) / 2)


class Ukf(Ekf):
    kappa = -1.0

    def weights(self, n):
        w = np.full(2 * n + 1, 0.5 / (n + self.kappa))
        w[0] = self.kappa / (n + self.kappa)
        return w

    def points(self, x, P):
        L = np.linalg.cholesky((len(x) + self.kappa) * P)
        return np.array([x, *(x + L.T), *(x - L.T)])

    def move(self, x, dt):
        return np.array([x[0] + dt * x[2], x[1] + dt * x[3], x[2], x[3]])

    def predict(self, x, P, dt):
        w = self.weights(4)
        X = np.array([self.move(p, dt) for p in self.points(x, P)])
        m = w @ X
        return m, (w * (X - m).T) @ (X - m) + self.Q(dt)

    def average(self, Z, w, scan):
        d = Z - Z[0]
        if scan.kind == "radar":
            d[:, 1] = wrap(d[:, 1])
        return Z[0] + w @ d

    def update(self, x, P, scan):
        w, X = self.weights(4), self.points(x, P)
        Z = np.array([self.h(p, scan) for p in X])
        z = self.average(Z, w, scan)
        dZ = Z - z
        if scan.kind == "radar":
            dZ[:, 1] = wrap(dZ[:, 1])
        S = (w * dZ.T) @ dZ + self.R(scan)
        K = (w * (X - x).T) @ dZ @ np.linalg.inv(S)
        P = P - K @ S @ K.T
        return x + K @ self.residual(scan, z), (P + P.T) / 2


class Ca(Ekf):
    def start(self, scan):
        x, P = first(scan)
        C = 4.0 * np.eye(6)
        C[:4, :4] = P
        return np.append(x, [0, 0]), C

    def F(self, dt):
        return np.eye(6) + dt * np.eye(6, k=2) + dt**2 / 2 * np.eye(6, k=4)

    def Q(self, dt):
        G = 4.0 * np.vstack([dt**3 / 6 * np.eye(2), dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        return G @ G.T


class Ctrv(Ekf):
    """px, py, v, course, turn rate, once the course is known."""

    small = 1e-3

    def move(self, s, dt):
        x, y, v, a, w = s
        b = a + w * dt
        if abs(w) < self.small:
            return np.array([x + v * dt * np.cos(a), y + v * dt * np.sin(a), v, b, w])
        return np.array([x + v / w * (np.sin(b) - np.sin(a)), y + v / w * (np.cos(a) - np.cos(b)), v, b, w])

    def slope_of_move(self, s, dt):
        _, _, v, a, w = s
        b = a + w * dt
        J = np.eye(5)
        J[3, 4] = dt
        if abs(w) < self.small:
            J[:2, 2] = dt * np.cos(a), dt * np.sin(a)
            J[:2, 3] = -v * dt * np.sin(a), v * dt * np.cos(a)
            J[:2, 4] = -v * dt**2 / 2 * np.sin(a), v * dt**2 / 2 * np.cos(a)
            return J
        ds, dc = np.sin(b) - np.sin(a), np.cos(a) - np.cos(b)
        J[:2, 2] = ds / w, dc / w
        J[:2, 3] = v / w * (np.cos(b) - np.cos(a)), v / w * ds
        J[:2, 4] = v / w * (dt * np.cos(b) - ds / w), v / w * (dt * np.sin(b) - dc / w)
        return J

    def flat(self, s):
        v, c, n = s[2], np.cos(s[3]), np.sin(s[3])
        J = np.array([[1, 0, 0, 0, 0], [0, 1, 0, 0, 0], [0, 0, c, -v * n, 0], [0, 0, n, v * c, 0]])
        return np.array([s[0], s[1], v * c, v * n]), J

    def step(self, state, scan):
        if state is None or len(state[1]) == 4:
            (t, x, P), out = Ekf.step(self, state, scan)
            v = np.hypot(x[2], x[3])
            if v > 8 * np.sqrt(max(P[2, 2], P[3, 3])):
                c, s = x[2] / v, x[3] / v
                J, C = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, c, s], [0, 0, -s / v, c / v]]), 0.1 * np.eye(5)
                C[:4, :4] = J @ P @ J.T
                x, P = np.array([x[0], x[1], v, np.arctan2(s, c), 0]), C
            return (t, x, P), out
        t, s, P = state
        dt = scan.time - t
        J, c, n = self.slope_of_move(s, dt), np.cos(s[3]), np.sin(s[3])
        G = np.array([[dt**2 / 2 * c, 0], [dt**2 / 2 * n, 0], [dt, 0], [0, dt**2 / 2], [0, dt]]) * [3.0, 0.6]
        s, P = self.move(s, dt), J @ P @ J.T + G @ G.T + 1e-9 * np.eye(5)
        x, B = self.flat(s)
        if scan.valid:
            H, R = slope(x, scan) @ B, scan.noise_covariance
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            A = np.eye(5) - K @ H
            s, P = s + K @ self.residual(scan, seen(x, scan)), A @ P @ A.T + K @ R @ K.T
            x, B = self.flat(s)
        C = B @ P @ B.T
        return (scan.time, s, P), (x, (C + C.T) / 2)


class Imm:
    sigmas = (1.0, 4.0)
    M = np.array([[0.97, 0.03], [0.10, 0.90]])

    def __init__(self):
        self.parts = [Ekf(), Ekf()]
        for f, s in zip(self.parts, self.sigmas):
            f.sigma = s

    def merge(self, w, xs, Ps):
        m = sum(a * x for a, x in zip(w, xs))
        return m, sum(a * (P + np.outer(x - m, x - m)) for a, x, P in zip(w, xs, Ps))

    def mixed(self, w, xs, Ps):
        J = w[:, None] * self.M
        c = J.sum(axis=0)
        return c, [self.merge(J[:, j] / c[j], xs, Ps) for j in range(2)]

    def weigh(self, c, fits):
        logs = np.log(c) + fits
        w = np.exp(logs - logs.max())
        return w / w.sum()

    def fit(self, f, x, P, scan):
        y, H = f.residual(scan, f.h(x, scan)), f.H(x, scan)
        S = H @ P @ H.T + f.R(scan)
        return -0.5 * (y @ np.linalg.solve(S, y) + np.linalg.slogdet(2 * np.pi * S)[1])

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            return (scan.time, np.array([0.5, 0.5]), [x, x], [P, P]), (x, P)
        t, w, xs, Ps = state
        w, beliefs = self.mixed(w, xs, Ps)
        beliefs = [f.predict(x, P, scan.time - t) for f, (x, P) in zip(self.parts, beliefs)]
        if scan.valid:
            w = self.weigh(w, np.array([self.fit(f, x, P, scan) for f, (x, P) in zip(self.parts, beliefs)]))
            beliefs = [f.update(x, P, scan) for f, (x, P) in zip(self.parts, beliefs)]
        w = np.maximum(w, 1e-12)
        w = w / w.sum()
        xs, Ps = [b[0] for b in beliefs], [b[1] for b in beliefs]
        m, C = self.merge(w, xs, Ps)
        return (scan.time, w, xs, Ps), (m, (C + C.T) / 2)
