import numpy as np
from bases import Ukf


class Tracker(Ukf):
    def predict(self, x, P, dt):
        self.P, self.dt = P, dt
        return Ukf.predict(self, x, P, dt)

    def update(self, x, P, scan):
        Q = self.Q(self.dt)
        m, C = Ukf.update(self, x, P - Q + 1e-9 * np.eye(4), scan)
        return m, C + Q
