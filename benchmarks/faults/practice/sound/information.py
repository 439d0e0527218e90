"""Information filter: the state is the inverse covariance and what it makes of the mean; updates only add."""

import numpy as np


class Tracker:
    q = 3.0

    def step(self, state, scan):
        if state is None:
            Lam, eta = self.prior(scan)
        else:
            last, Lam, eta = state
            Lam, eta = self.predict(Lam, eta, scan.time - last)
            if scan.valid:
                z, H, R = self.linear(scan, np.linalg.solve(Lam, eta)[2:])
                Ri = np.linalg.inv(R)
                Lam = Lam + H.T @ Ri @ H
                eta = eta + H.T @ Ri @ z
        P = np.linalg.inv(Lam)
        P = (P + P.T) / 2
        return (scan.time, Lam, eta), (P @ eta, P)

    def prior(self, scan):
        z, _, R = self.linear(scan, np.zeros(2))
        Lam = np.diag([0.0, 0.0, 1 / 400.0, 1 / 400.0])
        Lam[:2, :2] = np.linalg.inv(R[:2, :2])
        return Lam, Lam @ np.array([z[0], z[1], 0.0, 0.0])

    def predict(self, Lam, eta, dt):
        """With the inverse of the transition, and the process noise by the matrix inversion lemma."""
        Fi = np.eye(4) - dt * np.eye(4, k=2)
        G = np.vstack([np.eye(2) * dt**2 / 2, np.eye(2) * dt])
        M = Fi.T @ Lam @ Fi
        C = M @ G @ np.linalg.inv(G.T @ M @ G + np.eye(2) / self.q**2)
        L = np.eye(4) - C @ G.T
        Lam = L @ M @ L.T + C @ C.T / self.q**2
        return Lam, L @ Fi.T @ eta

    def linear(self, scan, velocity):
        yaw = scan.sensor_pose[2]
        if scan.kind != "radar":
            T = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            return scan.sensor_pose[:2] + T @ scan.measurement, np.eye(2, 4), T @ scan.noise_covariance @ T.T
        r, a, rate = scan.measurement
        c, s = np.cos(yaw + a), np.sin(yaw + a)
        vx, vy = velocity - scan.sensor_velocity
        J = np.array([[c, -r * s, 0], [s, r * c, 0], [0, s * vx - c * vy, 1]])
        p = scan.sensor_pose[:2] + r * np.array([c, s])
        z = np.array([p[0], p[1], rate + c * scan.sensor_velocity[0] + s * scan.sensor_velocity[1]])
        return z, np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, c, s]]), J @ scan.noise_covariance @ J.T
