import numpy as np
from bases import Ctrv


class Tracker(Ctrv):
    def slope_of_move(self, s, dt):
        J = Ctrv.slope_of_move(self, s, dt)
        v, a, b = s[2], s[3], s[3] + s[4] * dt
        r = v / s[4] if abs(s[4]) > self.small else v * dt
        J[0, 3], J[1, 3] = r * (np.sin(b) - np.sin(a)), r * (np.cos(a) - np.cos(b))
        return J
