from bases import Ekf


class Tracker(Ekf):
    def residual(self, scan, expected):
        return -Ekf.residual(self, scan, expected)
