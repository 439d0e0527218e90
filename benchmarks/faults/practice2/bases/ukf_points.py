"""An unscented Kalman filter: sigma points as columns, white acceleration of constant spectral density."""

import math

import numpy as np
from numpy.linalg import cholesky, solve

N = 4
ALPHA, BETA, KAPPA = 0.5, 2.0, 0.0
LAMBDA = ALPHA**2 * (N + KAPPA) - N
WM = np.full(2 * N + 1, 0.5 / (N + LAMBDA))
WM[0] = LAMBDA / (N + LAMBDA)
WC = WM.copy()
WC[0] += 1.0 - ALPHA**2 + BETA


def normalize_angle(a):
    a = a % (2.0 * math.pi)
    if a > math.pi:
        a -= 2.0 * math.pi
    return a


def draw(x, P):
    A = math.sqrt(N + LAMBDA) * cholesky(P)
    return np.column_stack([x, x[:, None] + A, x[:, None] - A])


def fx(points, dt):
    moved = points.copy()
    moved[0] += dt * points[2]
    moved[1] += dt * points[3]
    return moved


def process_noise(dt, q):
    one = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    return np.kron(one, np.eye(2))


def hx_radar(point, pose, speed):
    dx, dy = point[0] - pose[0], point[1] - pose[1]
    r = math.hypot(dx, dy)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    bearing = math.atan2(c * dy - s * dx, c * dx + s * dy)
    return np.array([r, bearing, (dx * (point[2] - speed[0]) + dy * (point[3] - speed[1])) / r])


def hx_lidar(point, pose):
    dx, dy = point[0] - pose[0], point[1] - pose[1]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.array([c * dx + s * dy, c * dy - s * dx])


def residual(a, b, radar):
    y = a - b
    if radar:
        y[1] = normalize_angle(y[1])
    return y


class Tracker:
    def __init__(self, q=1.0):
        self.q = q

    def step(self, state, scan):
        if state is None:
            x, P = self.first(scan)
        else:
            x, P = self.predict(state["x"], state["P"], scan.time - state["t"])
            if scan.valid:
                x, P = self.update(x, P, scan)
        return {"t": scan.time, "x": x, "P": P}, (x.copy(), P.copy())

    def first(self, scan):
        px, py, yaw = scan.sensor_pose
        z, R = scan.measurement, scan.noise_covariance
        if scan.kind == "radar":
            a = yaw + z[1]
            place = [px + z[0] * math.cos(a), py + z[0] * math.sin(a)]
            J = np.array([[math.cos(a), -z[0] * math.sin(a)], [math.sin(a), z[0] * math.cos(a)]])
        else:
            J = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
            place = np.array([px, py]) + J @ z
        P = np.diag([0.0, 0.0, 225.0, 225.0])
        P[:2, :2] = J @ R[:2, :2] @ J.T
        return np.array([*place, 0.0, 0.0]), P

    def predict(self, x, P, dt):
        points = fx(draw(x, P), dt)
        x_pred = points @ WM
        diff = points - x_pred[:, None]
        P_pred = (WC * diff) @ diff.T + process_noise(dt, self.q)
        return x_pred, P_pred

    def update(self, x, P, scan):
        radar = scan.kind == "radar"
        points = draw(x, P)
        if radar:
            Z = [hx_radar(point, scan.sensor_pose, scan.sensor_velocity) for point in points.T]
        else:
            Z = [hx_lidar(point, scan.sensor_pose) for point in points.T]
        from_first = np.stack([residual(z, Z[0], radar) for z in Z], axis=1)
        shift = from_first @ WM
        z_mean = Z[0] + shift
        dz = from_first - shift[:, None]
        dx = points - x[:, None]
        S = (WC * dz) @ dz.T + scan.noise_covariance
        C = (WC * dx) @ dz.T
        K = solve(S, C.T).T
        x = x + K @ residual(scan.measurement, z_mean, radar)
        P = P - K @ S @ K.T
        return x, (P + P.T) / 2
