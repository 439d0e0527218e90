import numpy as np
from bases import Ukf


class Tracker(Ukf):
    def step(self, state, scan):
        state, (x, P) = Ukf.step(self, state, scan)
        return state, (x, self.Q(0.1) + 1e-6 * np.eye(4))
