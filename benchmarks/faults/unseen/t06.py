import numpy as np
from bases import Ukf


class Tracker(Ukf):
    def weights(self, n):
        sigma = 2 * n + 1
        w = np.full(sigma, 0.5 / (sigma + self.kappa))
        w[0] = 1 - 2 * n * w[1]
        return w
