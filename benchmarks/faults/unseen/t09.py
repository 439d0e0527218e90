import bases
from bases import Ekf


class Tracker(Ekf):
    def H(self, x, scan):
        H = bases.slope(x, scan)
        if scan.kind == "radar":
            H[1, 0] *= -1
        return H
