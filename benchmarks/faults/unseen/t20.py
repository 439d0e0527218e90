import numpy as np
from bases import Ekf


class Tracker(Ekf):
    def update(self, x, P, scan):
        y, R = self.residual(scan, self.h(x, scan)), self.R(scan)
        if y @ np.linalg.solve(R, y) > 7.81:
            return x, P
        return Ekf.update(self, x, P, scan)
