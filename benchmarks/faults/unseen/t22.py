from bases import Ekf


class Tracker(Ekf):
    def residual(self, scan, expected):
        return scan.measurement - expected
