from bases import Ekf


class Tracker(Ekf):
    def predict(self, x, P, dt):
        return Ekf.predict(self, x, P, dt * 1e-3)
