"""An error-state filter: a nominal state is moved, the filter holds its error, and an update adds it to the state."""

import numpy as np
from benchmarks.faults.parts import difference, expected, first, moved, updated


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            return (scan.time, x, np.zeros(4), P), (x, P)
        time, nominal, error, P = state
        dt = scan.time - time
        nominal = np.concatenate([nominal[:2] + dt * nominal[2:], nominal[2:]])
        error, P = moved(error, P, dt)
        if scan.valid:
            prediction, H = expected(nominal, scan)
            error, P = updated(error, P, difference(scan.measurement, prediction, scan), H, scan.noise_covariance)
            nominal, error = nominal + error, np.zeros(4)
        return (scan.time, nominal, error, P), (nominal + error, P)
