"""Alpha-beta filter: the gain decreases to a floor, and the covariance is what that gives."""

import numpy as np

FLOOR = {"radar": (0.16, 0.012), "lidar": (0.40, 0.06)}


class Tracker:
    """Positions alone; alpha and beta by the number of measurements so far, not below those of the steady state."""

    manoeuvre = 2.5
    rhythm = 0.04

    def step(self, state, scan):
        if state is None:
            z, R = self.place(scan)
            P = np.diag([0.0, 0.0, 400.0, 400.0])
            P[:2, :2] = R
            x = np.array([z[0], z[1], 0.0, 0.0])
            return (scan.time, 1, x, P), (x, P)
        t, n, x, P = state
        dt = scan.time - t
        F = np.eye(4)
        F[[0, 1], [2, 3]] = dt
        w = self.manoeuvre * np.array([dt**2 / 2, dt])
        x = F @ x
        P = F @ P @ F.T + np.kron(np.outer(w, w), np.eye(2))
        if scan.valid:
            n += 1
            z, R = self.place(scan)
            alpha = max(2 * (2 * n - 1) / (n * (n + 1)), FLOOR[scan.kind][0])
            beta = max(6 / (n * (n + 1)), FLOOR[scan.kind][1])
            K = np.vstack([alpha * np.eye(2), beta / self.rhythm * np.eye(2)])
            A = np.eye(4)
            A[:, :2] -= K
            x = x + K @ (z - x[:2])
            P = A @ P @ A.T + K @ R @ K.T
        return (scan.time, n, x, P), (x, P)

    def place(self, scan):
        px, py, yaw = scan.sensor_pose
        if scan.kind == "radar":
            r, a = scan.measurement[:2]
            c, s = np.cos(yaw + a), np.sin(yaw + a)
            J = np.array([[c, -r * s], [s, r * c]])
            return np.array([px + r * c, py + r * s]), J @ scan.noise_covariance[:2, :2] @ J.T
        c, s = np.cos(yaw), np.sin(yaw)
        T = np.array([[c, -s], [s, c]])
        return np.array([px, py]) + T @ scan.measurement, T @ scan.noise_covariance @ T.T
