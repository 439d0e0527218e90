"""A filter of Student's t: state and noise have 8 degrees of freedom, and a large residual widens the covariance."""

import numpy as np
from benchmarks.faults.parts import first, linear_at, moved

DOF = 8.0
SPREAD = (DOF - 2) / DOF  # of the scale over the covariance


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            scale = SPREAD * P
        else:
            time, x, scale = state
            x, P = moved(x, scale / SPREAD, scan.time - time)
            scale = SPREAD * P
            if scan.valid:
                x, scale = self.corrected(x, scale, scan)
        return (scan.time, x, scale), (x, scale / SPREAD)

    def corrected(self, x, scale, scan):
        z, H, R = linear_at(scan, x[2:])
        R = R + 1e-6 * np.eye(len(z))
        y = z - H @ x
        S = H @ scale @ H.T + SPREAD * R
        K = np.linalg.solve(S, H @ scale).T
        d2 = y @ np.linalg.solve(S, y)
        more = DOF + len(y)  # degrees of freedom, which are brought back with the covariance as it is
        factor = (DOF + d2) / more * more / (more - 2) * SPREAD
        after = max(factor, 1.0) * (scale - K @ S @ K.T)  # a small residual does not narrow it
        return x + K @ y, (after + after.T) / 2 + 1e-9 * np.eye(4)
