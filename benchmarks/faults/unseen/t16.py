from bases import Ekf


class Tracker(Ekf):
    def Q(self, dt):
        return Ekf.Q(self, dt) * (1 + (self.px / 20) ** 2)

    def predict(self, x, P, dt):
        self.px = x[0]
        return Ekf.predict(self, x, P, dt)
