"""An extended Kalman filter for a coordinated turn: px, py, vx, vy and the turn rate."""

import numpy as np


class CoordinatedTurn:
    def __init__(self, acceleration_sigma, turn_sigma):
        self.acceleration_sigma = acceleration_sigma
        self.turn_sigma = turn_sigma

    def move(self, x, dt):
        px, py, vx, vy, w = x
        if abs(w) < 1e-4:
            return np.array([px + dt * vx, py + dt * vy, vx, vy, w])
        s, c = np.sin(w * dt), np.cos(w * dt)
        return np.array(
            [
                px + (s * vx - (1 - c) * vy) / w,
                py + ((1 - c) * vx + s * vy) / w,
                c * vx - s * vy,
                s * vx + c * vy,
                w,
            ]
        )

    def jacobian(self, x, dt):
        vx, vy, w = x[2:]
        s, c = np.sin(w * dt), np.cos(w * dt)
        F = np.eye(5)
        if abs(w) < 1e-4:
            F[0, 2] = F[1, 3] = dt
            F[:4, 4] = -(dt**2) / 2 * vy, dt**2 / 2 * vx, -dt * vy, dt * vx
            return F
        F[0, 2:4] = s / w, -(1 - c) / w
        F[1, 2:4] = (1 - c) / w, s / w
        F[2, 2:4] = c, -s
        F[3, 2:4] = s, c
        ds, dc = (dt * c * w - s) / w**2, (dt * s * w - (1 - c)) / w**2  # of s / w and of (1 - c) / w
        F[0, 4] = ds * vx - dc * vy
        F[1, 4] = dc * vx + ds * vy
        F[2, 4] = -dt * (s * vx + c * vy)
        F[3, 4] = dt * (c * vx - s * vy)
        return F

    def noise(self, dt):
        Q = np.zeros((5, 5))
        G = np.array([[dt**2 / 2, 0.0], [0.0, dt**2 / 2], [dt, 0.0], [0.0, dt]])
        Q[:4, :4] = self.acceleration_sigma**2 * G @ G.T
        Q[4, 4] = self.turn_sigma**2 * dt
        return Q


def measurement_model(x, scan):
    px, py, yaw = scan.sensor_pose
    dx, dy = x[0] - px, x[1] - py
    c, s = np.cos(yaw), np.sin(yaw)
    H = np.zeros((len(scan.measurement), 5))
    if scan.kind == "lidar":
        H[:, :2] = [[c, s], [-s, c]]
        return H[:, :2] @ [dx, dy], H
    r = np.sqrt(dx**2 + dy**2)
    vx, vy = x[2] - scan.sensor_velocity[0], x[3] - scan.sensor_velocity[1]
    rate = (vx * dx + vy * dy) / r
    H[0, :2] = dx / r, dy / r
    H[1, :2] = -dy / r**2, dx / r**2
    H[2, :2] = (vx - rate * dx / r) / r, (vy - rate * dy / r) / r
    H[2, 2:4] = dx / r, dy / r
    return np.array([r, np.arctan2(dy, dx) - yaw, rate]), H


class Tracker:
    def __init__(self, acceleration_sigma=2.0, turn_sigma=0.3, speed_sigma=20.0):
        self.model = CoordinatedTurn(acceleration_sigma, turn_sigma)
        self.speed_sigma = speed_sigma

    def step(self, state, scan):
        if state is None:
            x, P = self.start(scan)
        else:
            time, x, P = state
            dt = scan.time - time
            F = self.model.jacobian(x, dt)
            x = self.model.move(x, dt)
            P = F @ P @ F.T + self.model.noise(dt)
            if scan.valid:
                x, P = self.update(x, P, scan)
        return (scan.time, x, P), (x[:4].copy(), P[:4, :4].copy())

    def start(self, scan):
        px, py, yaw = scan.sensor_pose
        radar = scan.kind == "radar"
        r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if radar else (1.0, yaw)
        c, s = np.cos(angle), np.sin(angle)
        J = np.array([[c, -r * s], [s, r * c]])
        offset = J @ ([r, 0.0] if radar else scan.measurement)
        P = np.diag([0.0, 0.0, self.speed_sigma**2, self.speed_sigma**2, 0.3**2])
        P[:2, :2] = J @ scan.noise_covariance[:2, :2] @ J.T
        return np.array([px + offset[0], py + offset[1], 0.0, 0.0, 0.0]), P

    def update(self, x, P, scan):
        expected, H = measurement_model(x, scan)
        y = scan.measurement - expected
        if scan.kind == "radar":
            while y[1] > np.pi:
                y[1] -= 2 * np.pi
            while y[1] < -np.pi:
                y[1] += 2 * np.pi
        S = H @ P @ H.T + scan.noise_covariance
        K = P @ H.T @ np.linalg.inv(S)
        P = P - K @ S @ K.T
        return x + K @ y, (P + P.T) / 2
