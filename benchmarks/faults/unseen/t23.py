import numpy as np
from bases import Ca


class Tracker(Ca):
    def predict(self, x, P, dt):
        A = np.eye(6)
        A[:4, :4] += dt * np.eye(4, k=2)
        return self.F(dt) @ x, A @ P @ A.T + self.Q(dt)
