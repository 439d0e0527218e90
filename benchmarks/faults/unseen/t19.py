import bases
import numpy as np
from bases import Ekf


class Tracker(Ekf):
    def h(self, x, scan):
        z = bases.seen(x, scan)
        if scan.kind == "radar":
            z[2] = self.H(x, scan)[2] @ np.append([0, 0], x[2:] - scan.sensor_velocity)
        return z

    def H(self, x, scan):
        H = bases.slope(x, scan)
        if scan.kind == "radar":
            H[2] = 0, 0, np.cos(scan.sensor_pose[2]), np.sin(scan.sensor_pose[2])
        return H
