"""The state has the places of the last two measurements too, smoothed; what is shown is the present."""

import numpy as np
from benchmarks.faults.parts import constant_velocity, difference, expected, first


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            T = np.vstack([np.eye(4), np.eye(2, 4), np.eye(2, 4)])
            x, P = T @ x, T @ P @ T.T
        else:
            time, x, P = state
            F, Q = np.eye(8), np.zeros((8, 8))
            F[:4, :4], Q[:4, :4] = constant_velocity(scan.time - time)
            x, P = F @ x, F @ P @ F.T + Q
            if scan.valid:
                x, P = self.updated(x, P, scan)
        return (scan.time, x, P), (x[:4], P[:4, :4])

    def updated(self, x, P, scan):
        h, H = expected(x[:4], scan)
        H = np.hstack([H, np.zeros((len(H), 4))])
        S = H @ P @ H.T + scan.noise_covariance
        K = np.linalg.solve(S, H @ P).T
        x = x + K @ difference(scan.measurement, h, scan)
        P = P - K @ S @ K.T
        shift = np.eye(8)  # the present is remembered in place of the last, and that in place of the one before
        shift[4:6], shift[6:8] = np.eye(2, 8), np.eye(2, 8, k=4)
        P = shift @ P @ shift.T
        return shift @ x, (P + P.T) / 2
