from bases import Ekf


class Tracker(Ekf):
    def residual(self, scan, expected):
        z = scan.measurement.copy()
        if scan.kind == "radar" and abs(z[2]) < 2.0:
            z[2] = 0.0
        return Ekf.residual(self, scan._replace(measurement=z), expected)
