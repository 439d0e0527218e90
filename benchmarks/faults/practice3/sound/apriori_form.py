"""A filter in the a priori form: it ends each step with the prediction for the time at which it expects the next scan.

Where the next scan comes at another time, the prediction is made again from the estimate.
"""

import numpy as np
from benchmarks.faults.parts import first, linear_at, moved, updated


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            interval = 0.05
        else:
            x, P = self.prior(state, scan.time)
            if scan.valid:
                x, P = updated(x, P, *linear_at(scan, x[2:]))
                P = (P + P.T) / 2
            elapsed = scan.time - state["time"]
            interval = elapsed if elapsed > 0 else state["interval"]
        ahead = (scan.time + interval, *moved(x, P, interval))
        return {"time": scan.time, "now": (x, P), "ahead": ahead, "interval": interval}, (x, P)

    def prior(self, state, time):
        expected, x, P = state["ahead"]
        if np.isclose(expected, time, rtol=0.0, atol=1e-6):
            return x, P
        return moved(*state["now"], time - state["time"])
