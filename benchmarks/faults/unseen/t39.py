import numpy as np
from bases import Ekf


class Tracker(Ekf):
    def step(self, state, scan):
        later, (x, P) = Ekf.step(self, state, scan)
        order = [0, 2, 1, 3]
        return later, (x, P[np.ix_(order, order)])
