import numpy as np
from bases import Ekf


class Tracker(Ekf):
    def update(self, x, P, scan):
        H, R = self.H(x, scan), self.R(scan)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        P = (np.eye(4) - K @ H) @ P
        K[:, 1] = 0
        return x + K @ self.residual(scan, self.h(x, scan)), (P + P.T) / 2
