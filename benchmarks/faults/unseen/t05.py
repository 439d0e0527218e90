import bases
import numpy as np
from bases import Ukf


class Tracker(Ukf):
    kappa = 0.5

    def points(self, x, P):
        L = np.linalg.cholesky((len(x) + self.kappa) * P)
        return np.array([x, *(x + L), *(x - L)])

    def update(self, x, P, scan):
        w, X = self.weights(4), self.points(x, P)
        Z = np.array([self.h(p, scan) for p in X])
        z = self.average(Z, w, scan)
        dZ = Z - z
        if scan.kind == "radar":
            dZ[:, 1] = bases.wrap(dZ[:, 1])
        S, C = (w * dZ.T) @ dZ + self.R(scan), (w * (X - x).T) @ dZ
        K = C @ np.linalg.inv(S)
        return x + K @ self.residual(scan, z), (w * (X - x).T) @ (X - x) - K @ C.T
