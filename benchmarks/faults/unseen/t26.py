import bases
import numpy as np
from bases import Ekf


class Tracker(Ekf):
    def start(self, scan):
        x, P = bases.first(scan)
        return x, np.diag(np.sqrt(np.diag(P)))
