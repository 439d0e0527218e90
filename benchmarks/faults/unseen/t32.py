import bases
import numpy as np
from bases import Ekf


class Tracker(Ekf):
    def h(self, x, scan):
        z = bases.seen(x, scan)
        if scan.kind == "radar" and np.hypot(x[2], x[3]) > 1:
            z[1] = bases.wrap(np.arctan2(x[3], x[2]) - scan.sensor_pose[2])
        return z
