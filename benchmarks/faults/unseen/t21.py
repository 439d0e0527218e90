import numpy as np
from bases import Ekf


class Tracker(Ekf):
    gate = 9.0

    def step(self, state, scan):
        if state is not None and scan.valid:
            t, x, P = state
            x1, P1 = self.predict(x, P, min(scan.time - t, 0.05))
            H, y = self.H(x1, scan), self.residual(scan, self.h(x1, scan))
            if y @ np.linalg.solve(H @ P1 @ H.T + self.R(scan), y) > self.gate:
                return (scan.time, x + np.append(0.05 * x[2:], [0, 0]), P), (x, P)
        return Ekf.step(self, state, scan)
