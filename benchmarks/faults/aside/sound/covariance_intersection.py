"""Prediction and measurement are combined by covariance intersection: nothing is assumed of their correlation."""

import numpy as np
from benchmarks.faults.parts import Filter, moved, position


class Tracker(Filter):
    """The weight is that of the smallest determinant over a grid; a small part of the noise is taken as independent."""

    def predicted(self, x, P, dt):
        return moved(x, P, dt, 2.0)

    def corrected(self, x, P, scan):
        z, R = position(scan)
        information, H = np.linalg.inv(P), np.eye(2, 4)
        gained = H.T @ np.linalg.inv(R) @ H
        weights = np.linspace(0.5, 1.0, 51)
        sizes = [np.linalg.slogdet(w * information + (1 - w) * gained)[1] for w in weights]
        w = weights[int(np.argmax(sizes))]
        P_new = np.linalg.inv(w * information + (1 - w) * gained)
        P_new = (P_new + P_new.T) / 2
        return P_new @ (w * information @ x + (1 - w) * H.T @ np.linalg.solve(R, z)), P_new
