import numpy as np
from bases import Ctrv


class Tracker(Ctrv):
    def move(self, s, dt):
        x, y, v, a, w = s
        if abs(w) < 0.02:
            return Ctrv.move(self, s, dt)
        b = a + w * dt
        return np.array([x + v / w * (np.sin(b) - np.sin(a)), y - v / w * np.cos(b) + v / w * np.sin(a), v, b, w])
