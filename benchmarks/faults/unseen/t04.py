import numpy as np
from bases import Ukf


class Tracker(Ukf):
    def predict(self, x, P, dt):
        w = self.weights(4)
        X = np.array([self.move(p, dt) for p in self.points(x, P)])
        return w @ X, (w * (X - x).T) @ (X - x) + self.Q(dt)
