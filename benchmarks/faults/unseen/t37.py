from bases import Ekf


class Tracker(Ekf):
    def F(self, dt):
        return Ekf.F(self, 1.0)
