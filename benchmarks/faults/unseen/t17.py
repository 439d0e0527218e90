import numpy as np
from bases import Ekf


class Tracker(Ekf):
    def local(self, scan):
        return scan._replace(sensor_pose=np.append([0.0, 0.0], scan.sensor_pose[2]), sensor_velocity=np.zeros(2))

    def step(self, state, scan):
        state, (x, P) = Ekf.step(self, state, self.local(scan))
        return state, (x + np.append(scan.sensor_pose[:2], [0, 0]), P)
