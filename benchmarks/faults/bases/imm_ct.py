"""Constant velocity and coordinated turn in an interacting-multiple-model filter, in the order of FilterPy's.

Probabilities and weights of the next mixing are computed at the end of an update. State: px, py, vx, vy, turn rate.
"""

import numpy as np


class Model:
    def __init__(self, sigma_a, sigma_turn, turns):
        self.sigma_a, self.sigma_turn, self.turns = sigma_a, sigma_turn, turns

    def predict(self, x, P, dt):
        w = x[4] if self.turns else 0.0
        s, c = np.sin(w * dt), np.cos(w * dt)
        near = abs(w) < 1e-6
        a = dt if near else s / w
        b = 0.5 * w * dt**2 if near else (1 - c) / w
        F = np.array([[1, 0, a, -b, 0], [0, 1, b, a, 0], [0, 0, c, -s, 0], [0, 0, s, c, 0], [0, 0, 0, 0, 1.0]])
        moved = F @ x
        if self.turns:
            vx, vy = x[2:4]
            da = -w * dt**3 / 3 if near else (c * dt * w - s) / w**2
            db = dt**2 / 2 if near else (s * dt * w - 1 + c) / w**2
            F[:4, 4] = [da * vx - db * vy, db * vx + da * vy, -dt * (s * vx + c * vy), dt * (c * vx - s * vy)]
        G = np.array([[dt**2 / 2, 0], [0, dt**2 / 2], [dt, 0], [0, dt], [0, 0]])
        Q = self.sigma_a**2 * G @ G.T
        Q[4, 4] = self.sigma_turn**2 * dt
        if not self.turns:  # its turn rate is none
            moved[4], F[4, 4] = 0.0, 0.0
        return moved, F @ P @ F.T + Q


class Tracker:
    def __init__(self):
        self.models = [Model(2.0, 0.02, False), Model(3.0, 0.4, True)]
        self.M = np.array([[0.99, 0.01], [0.10, 0.90]])  # M[i, j]: from i to j

    def step(self, state, scan):
        if state is None:
            z, _, R = self.linear(scan)
            x = np.array([z[0], z[1], 0.0, 0.0, 0.0])
            P = np.diag([0.0, 0.0, 400.0, 400.0, 0.01])
            P[:2, :2] = R[:2, :2]
            mu = np.array([0.9, 0.1])
            cbar, omega = self.mixing_probabilities(mu)
            return (scan.time, [x, x], [P, P], mu, cbar, omega), (x[:4], P[:4, :4])
        time, xs, Ps, mu, cbar, omega = state
        xs, Ps = self.predict(xs, Ps, omega, scan.time - time)
        if scan.valid:
            xs, Ps, likelihood = self.correct(xs, Ps, *self.linear(scan))
            mu = cbar * likelihood
            mu = mu / mu.sum()
            cbar, omega = self.mixing_probabilities(mu)
        else:
            mu = cbar
            cbar, omega = self.mixing_probabilities(mu)
        x, P = self.state_estimate(xs, Ps, mu)
        return (scan.time, xs, Ps, mu, cbar, omega), (x[:4], P[:4, :4])

    def mixing_probabilities(self, mu):
        cbar = mu @ self.M
        omega = self.M * mu[:, None] / cbar
        return cbar, omega

    def predict(self, xs, Ps, omega, dt):
        mixed_x, mixed_P = [], []
        for j in range(len(xs)):
            x0, P0 = self.state_estimate(xs, Ps, omega[:, j])
            x, P = self.models[j].predict(x0, P0, dt)
            mixed_x.append(x)
            mixed_P.append(P)
        return mixed_x, mixed_P

    def correct(self, xs, Ps, z, H, R):
        new_x, new_P, log = [], [], []
        for x, P in zip(xs, Ps, strict=True):
            y, S = z - H @ x, H @ P @ H.T + R
            K = P @ H.T @ np.linalg.inv(S)
            new_x.append(x + K @ y)
            new_P.append((np.eye(5) - K @ H) @ P @ (np.eye(5) - K @ H).T + K @ R @ K.T)
            log.append(-0.5 * (y @ np.linalg.inv(S) @ y + np.log(np.linalg.det(S))))
        return new_x, new_P, np.exp(np.array(log) - max(log))

    def state_estimate(self, xs, Ps, weights):
        x = sum(w * xi for w, xi in zip(weights, xs, strict=True))
        P = sum(w * (Pi + np.outer(xi - x, xi - x)) for w, xi, Pi in zip(weights, xs, Ps, strict=True))
        return x, P

    def linear(self, scan):
        """z, H, R in the fixed frame: the position, and of a radar the speed over ground along the ray."""
        radar, yaw = scan.kind == "radar", scan.sensor_pose[2]
        r, angle = (scan.measurement[0], yaw + scan.measurement[1]) if radar else (1.0, yaw)
        c, s = np.cos(angle), np.sin(angle)
        J = np.array([[c, -r * s], [s, r * c]])
        z = scan.sensor_pose[:2] + J @ (np.array([r, 0.0]) if radar else scan.measurement)
        R = J @ scan.noise_covariance[:2, :2] @ J.T
        if not radar:
            return z, np.eye(2, 5), R
        z = np.append(z, scan.measurement[2] + np.array([c, s]) @ scan.sensor_velocity)
        H = np.vstack([np.eye(2, 5), [0.0, 0.0, c, s, 0.0]])
        R = np.pad(R, (0, 1))
        R[2, 2] = scan.noise_covariance[2, 2]
        return z, H, R
