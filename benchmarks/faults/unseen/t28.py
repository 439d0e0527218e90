from bases import Ekf


class Tracker(Ekf):
    def step(self, state, scan):
        later, estimate = Ekf.step(self, state, scan)
        return (scan.time if state is None else state[0], *later[1:]), estimate
