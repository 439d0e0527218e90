import numpy as np
from bases import Ekf


class Tracker(Ekf):
    def back(self, scan):
        x, y, yaw = scan.sensor_pose
        return scan._replace(sensor_pose=np.array([x, y, -yaw])) if scan.kind == "lidar" else scan

    def step(self, state, scan):
        return Ekf.step(self, state, self.back(scan))
