from bases import Ekf


class Tracker(Ekf):
    last = [0.0]

    def step(self, state, scan):
        if state is not None:
            state = (min(self.last[0], scan.time), *state[1:])
        later, estimate = Ekf.step(self, state, scan)
        self.last[0] = scan.time
        return later, estimate
