import numpy as np
from bases import Ekf


class Tracker(Ekf):
    def R(self, scan):
        return np.diag(np.sqrt(np.diag(scan.noise_covariance)))
