import bases
import numpy as np
from bases import Ekf


class Tracker(Ekf):
    def start(self, scan):
        x = bases.first(scan)[0]
        s = abs(x[0])
        return x, np.diag([0.002 * s, 0.002 * s, 0.02 * s, 0.02 * s]) ** 2 + 1e-6 * np.eye(4)
