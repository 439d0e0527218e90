"""A filter in single precision, as for a small processor; places are counted from where the object was first seen."""

import numpy as np
from benchmarks.faults.parts import first, linear_at

f = np.float32


class Tracker:
    def __init__(self, acceleration_sigma=3.0):
        self.q = f(acceleration_sigma**2)

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            origin, x, P = x[:2], np.array([0, 0, 0, 0], f), P.astype(f)
        else:
            time, origin, x, P = state
            x, P = self.predict(x, P, f(scan.time - time))
            if scan.valid:
                z, H, R = linear_at(scan, x[2:].astype(float))
                z[:2] -= origin
                x, P = self.update(x, P, z.astype(f), H.astype(f), R.astype(f))
        mean, covariance = x.astype(float), P.astype(float)
        mean[:2] += origin
        return (scan.time, origin, x, P), (mean, covariance)

    def predict(self, x, P, dt):
        F = np.eye(4, dtype=f)
        F[0, 2] = F[1, 3] = dt
        Q = np.zeros((4, 4), f)
        Q[0, 0] = Q[1, 1] = self.q * dt**4 / 4
        Q[2, 2] = Q[3, 3] = self.q * dt**2
        Q[0, 2] = Q[2, 0] = Q[1, 3] = Q[3, 1] = self.q * dt**3 / 2
        P = F @ P @ F.T + Q
        return F @ x, (P + P.T) / f(2)

    def update(self, x, P, z, H, R):
        S = H @ P @ H.T + R
        K = np.linalg.solve(S, H @ P).T
        A = np.eye(4, dtype=f) - K @ H
        P = A @ P @ A.T + K @ R @ K.T
        return x + K @ (z - H @ x), (P + P.T) / f(2)
