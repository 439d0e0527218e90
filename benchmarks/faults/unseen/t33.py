import numpy as np
from bases import Ekf


class Tracker(Ekf):
    def R(self, scan):
        R = scan.noise_covariance.copy()
        if scan.kind == "radar":
            R[1, 1] = np.degrees(np.sqrt(R[1, 1])) ** 2
        return R
