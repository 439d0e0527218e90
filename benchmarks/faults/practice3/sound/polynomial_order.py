"""Singer's model with the state px, vx, ax, py, vy, ay, for all objects and runs in one call."""

import numpy as np

ORDER = [0, 3, 1, 4]  # of px, py, vx, vy in the state


class Tracker:
    batched = True

    def __init__(self, manoeuvre_s=1.5, acceleration_sigma=3.0):
        self.alpha, self.sigma = 1 / manoeuvre_s, acceleration_sigma

    def step(self, state, scan):
        n = scan.valid.size
        if state is None:
            state = scan.time, np.zeros((n, 6)), np.zeros((n, 6, 6)), np.zeros(n, bool)
        time, x, P, known = state
        F, Q = self.motion(scan.time - time)
        x, P = x @ F.T, F @ P @ F.T + Q
        seen = np.asarray(scan.valid, bool)
        z, H, R = self.linear(scan, x)
        born = np.tile(np.diag([0.0, 400.0, self.sigma**2] * 2), (n, 1, 1))
        start = np.zeros((n, 6))
        start[:, [0, 3]] = z[:, :2]
        born[:, [[0], [3]], [[0, 3]]] = R[:, :2, :2]
        HP = H @ P
        K = np.linalg.solve(
            HP @ H.transpose(0, 2, 1) + R + np.where(known & seen, 0, 1)[:, None, None] * np.eye(len(z[0])), HP
        )
        K = K.transpose(0, 2, 1)
        A = np.eye(6) - K @ H
        later = x + np.einsum("nij,nj->ni", K, z - np.einsum("nij,nj->ni", H, x))
        later_P = A @ P @ A.transpose(0, 2, 1) + K @ R @ K.transpose(0, 2, 1)
        old, new = (known & seen), (~known & seen)
        x = np.where(old[:, None], later, np.where(new[:, None], start, x))
        P = np.where(old[:, None, None], later_P, np.where(new[:, None, None], born, P))
        P = (P + P.transpose(0, 2, 1)) / 2
        known = known | seen
        mean = np.where(known[:, None], x[:, ORDER], np.nan)
        covariance = np.where(known[:, None, None], P[:, ORDER][:, :, ORDER], np.nan)
        return (scan.time, x, P, known), (mean.T, covariance.transpose(1, 2, 0))

    def motion(self, dt):
        a = self.alpha
        decay = np.exp(-a * dt)
        f = np.array([[1, dt, (a * dt - 1 + decay) / a**2], [0, 1, (1 - decay) / a], [0, 0, decay]])
        q = (
            2
            * a
            * self.sigma**2
            * np.array(
                [[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]]
            )
        )
        return np.kron(np.eye(2), f), np.kron(np.eye(2), q)

    def linear(self, scan, x):
        """Positions and speeds along the rays; what was not seen has zeros."""
        n, (px, py, yaw) = scan.valid.size, scan.sensor_pose
        m = np.where(scan.valid, scan.measurement, 0.0)
        H = np.zeros((n, len(m), 6))
        H[:, 0, 0] = H[:, 1, 3] = 1.0
        if scan.kind != "radar":
            c, s = np.cos(yaw), np.sin(yaw)
            T = np.array([[c, -s], [s, c]])
            return (T @ m).T + np.array([px, py]), H, np.tile(T @ scan.noise_covariance @ T.T, (n, 1, 1))
        r, c, s = m[0], np.cos(yaw + m[1]), np.sin(yaw + m[1])
        vx, vy = scan.sensor_velocity
        z = np.column_stack([px + r * c, py + r * s, m[2] + c * vx + s * vy])
        H[:, 2, 1], H[:, 2, 4] = c, s
        J = np.zeros((n, 3, 3))
        J[:, 0, 0], J[:, 0, 1], J[:, 1, 0], J[:, 1, 1] = c, -r * s, s, r * c
        J[:, 2, 1], J[:, 2, 2] = s * (x[:, 1] - vx) - c * (x[:, 4] - vy), 1.0
        return z, H, J @ scan.noise_covariance @ J.transpose(0, 2, 1)
