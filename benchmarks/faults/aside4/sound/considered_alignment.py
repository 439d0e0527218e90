"""Schmidt's filter: the yaw error of each sensor's mount is considered and never estimated."""

import numpy as np
from benchmarks.faults.parts import difference, expected, first, moved

SIGMA = np.radians(0.3)  # of each mount's yaw error
OF = {"radar": 0, "lidar": 1}


def by_yaw(x, scan):
    """Derivative of what the sensor measures by the yaw error of its mount."""
    if scan.kind == "radar":
        return np.array([0.0, -1.0, 0.0])
    local = expected(x, scan)[0]
    return np.array([local[1], -local[0]])


class Tracker:
    def __init__(self):
        self.B = SIGMA**2 * np.eye(2)

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            C = np.zeros((4, 2))  # of the state and the considered errors
            arm = x[:2] - scan.sensor_pose[:2]
            C[:2, OF[scan.kind]] = SIGMA**2 * np.array([-arm[1], arm[0]])
            P[:2, :2] += SIGMA**2 * np.outer([-arm[1], arm[0]], [-arm[1], arm[0]])
        else:
            time, x, P, C = state
            dt = scan.time - time
            x, P = moved(x, P, dt)
            C = C + dt * np.vstack([C[2:], np.zeros((2, 2))])
            if scan.valid:
                x, P, C = self.corrected(x, P, C, scan)
        return (scan.time, x, P, C), (x, (P + P.T) / 2)

    def corrected(self, x, P, C, scan):
        predicted, H = expected(x, scan)
        N = np.zeros((len(H), 2))
        N[:, OF[scan.kind]] = by_yaw(x, scan)
        cross = P @ H.T + C @ N.T
        S = H @ cross + N @ (C.T @ H.T + self.B @ N.T) + scan.noise_covariance
        K = np.linalg.solve(S, cross.T).T
        y = difference(scan.measurement, predicted, scan)
        return x + K @ y, P - K @ S @ K.T, C - K @ (H @ C + N @ self.B)
