"""A Schmidt-Kalman filter: a bias of each sensor is considered, and never estimated."""

import numpy as np
from benchmarks.faults.parts import first, moved, position, transition

BIAS = 0.1**2  # m², in the fixed frame, of each sensor


class Tracker:
    """State px, py, vx, vy; beside its covariance those with the biases of radar and lidar."""

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            C = {kind: np.zeros((4, 2)) for kind in ("radar", "lidar")}
            C[scan.kind] = BIAS * np.eye(4, 2)
            P[:2, :2] += BIAS * np.eye(2)
            return (scan.time, x, P, C), (x, P)
        time, x, P, C = state
        dt = scan.time - time
        x, P = moved(x, P, dt)
        C = {kind: transition(dt) @ cross for kind, cross in C.items()}
        if scan.valid:
            z, R = position(scan)
            H, B = np.eye(2, 4), C[scan.kind]
            PHt = P @ H.T + B
            S = H @ P @ H.T + H @ B + (H @ B).T + BIAS * np.eye(2) + R
            K = np.linalg.solve(S, PHt.T).T
            x = x + K @ (z - H @ x)
            P = P - K @ PHt.T - PHt @ K.T + K @ S @ K.T
            P = (P + P.T) / 2
            own = {kind: BIAS * np.eye(2) if kind == scan.kind else np.zeros((2, 2)) for kind in C}
            C = {kind: cross - K @ (H @ cross + own[kind]) for kind, cross in C.items()}
        return (scan.time, x, P, C), (x, P)
