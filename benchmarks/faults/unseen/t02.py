import numpy as np
from bases import Ekf


class Tracker(Ekf):
    def Q(self, dt):
        return np.diag([0.1, 0.1, self.sigma**2, self.sigma**2])
