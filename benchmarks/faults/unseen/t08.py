import numpy as np
from bases import Ukf


class Tracker(Ukf):
    def predict(self, x, P, dt):
        w = self.weights(4)
        X = self.points(x, P) + np.array([dt * x[2], dt * x[3], 0, 0])
        m = w @ X
        return m, (w * (X - m).T) @ (X - m) + self.Q(dt)
