"""A square-root Kalman filter on positions in the fixed frame: it carries lower triangular roots, never P itself."""

import numpy as np


def triangular(*blocks):
    """Lower triangular L with L Lᵀ = the sum of B Bᵀ over the blocks."""
    upper = np.linalg.qr(np.hstack(blocks).T, mode="r")
    return upper.T * np.where(np.diag(upper) < 0, -1.0, 1.0)


class SquareRootFilter:
    """State px, vx, py, vy: one axis after the other."""

    def __init__(self, x, root):
        self.x, self.P1_2 = x, root

    @property
    def P(self):
        return self.P1_2 @ self.P1_2.T

    def predicted(self, F, Q1_2):
        return SquareRootFilter(F @ self.x, triangular(F @ self.P1_2, Q1_2))

    def corrected(self, z, H, R1_2):
        m, n = H.shape
        pre = np.zeros((m + n, m + n))
        pre[:m, :m] = R1_2
        pre[:m, m:] = H @ self.P1_2
        pre[m:, m:] = self.P1_2
        post = triangular(pre)
        S1_2, gain_S1_2, P1_2 = post[:m, :m], post[m:, :m], post[m:, m:]
        y = np.linalg.solve(S1_2, z - H @ self.x)
        return SquareRootFilter(self.x + gain_S1_2 @ y, P1_2)


class Tracker:
    H = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0]])
    ORDER = (0, 2, 1, 3)  # to px, py, vx, vy

    def __init__(self, acceleration_sigma=3.0):
        self.acceleration_sigma = acceleration_sigma

    def step(self, state, scan):
        if state is None:
            z, R1_2 = self.position(scan)
            root = np.zeros((4, 4))
            root[0, 0], root[2, 0], root[2, 2] = R1_2[0, 0], R1_2[1, 0], R1_2[1, 1]
            root[1, 1] = root[3, 3] = 20.0
            kf = SquareRootFilter(np.array([z[0], 0.0, z[1], 0.0]), root)
        else:
            time, kf = state
            dt = scan.time - time
            one_axis = np.array([[1.0, dt], [0.0, 1.0]])
            push = self.acceleration_sigma * np.array([[dt**2 / 2], [dt]])
            kf = kf.predicted(np.kron(np.eye(2), one_axis), np.kron(np.eye(2), push))
            if scan.valid:
                kf = kf.corrected(*self.with_model(*self.position(scan)))
        order = np.ix_(self.ORDER, self.ORDER)
        return (scan.time, kf), (kf.x[list(self.ORDER)], kf.P[order])

    def with_model(self, z, R1_2):
        return z, self.H, R1_2

    def position(self, scan):
        """The position in the fixed frame, and a lower triangular root of its covariance."""
        x, y, yaw = scan.sensor_pose
        root = np.linalg.cholesky(scan.noise_covariance[:2, :2])
        if scan.kind == "radar":
            r, angle = scan.measurement[0], yaw + scan.measurement[1]
            J = np.array([[np.cos(angle), -r * np.sin(angle)], [np.sin(angle), r * np.cos(angle)]])
            local = np.array([r, 0.0])
        else:
            J = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            local = scan.measurement
        return np.array([x, y]) + J @ local, triangular(J @ root)
