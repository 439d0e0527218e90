from bases import Ekf


class Tracker(Ekf):
    def step(self, state, scan):
        later, estimate = Ekf.step(self, state, scan)
        return (later if state is None or scan.valid else (scan.time, *state[1:])), estimate
