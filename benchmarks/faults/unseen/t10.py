import numpy as np
from bases import Ekf


class Tracker(Ekf):
    sigma = 2.0

    def Q(self, dt):
        G = np.vstack([dt**2 / 2 * np.eye(2), dt * np.eye(2)])
        return G @ (np.diag([0.2, 0.2]) ** 1) @ G.T * self.sigma
