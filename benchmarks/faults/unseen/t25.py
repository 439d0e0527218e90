import numpy as np
from bases import Ukf


class Tracker(Ukf):
    def weights(self, n):
        a2 = np.float32(0.05) ** 2
        lam = np.float32(a2 * np.float32(n)) - np.float32(n)
        self.kappa = float(lam)
        w = np.full(2 * n + 1, np.float32(0.5) / np.float32(a2 * n), dtype="f4")
        w[0] = lam / np.float32(n + lam)
        return w.astype(float)

    def points(self, x, P):
        L = np.linalg.cholesky(0.01 * P)
        return np.array([x, *(x + L.T), *(x - L.T)]).astype("f4").astype(float)

    def predict(self, x, P, dt):
        x, P = Ukf.predict(self, x, P, dt)
        return x, self.mend(P)

    def update(self, x, P, scan):
        x, P = Ukf.update(self, x, P, scan)
        return x, self.mend(P)

    def mend(self, P):
        d, V = np.linalg.eigh((P + P.T) / 2)
        return V * np.maximum(d, 1e-4) @ V.T
