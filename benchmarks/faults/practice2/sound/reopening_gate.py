"""A filter with a gate that two rejections in a row open, and with a covariance that then grows."""

import numpy as np
from benchmarks.faults import parts

GATES = {2: 18.42, 3: 21.11}  # 0.9999 by degrees of freedom


class Tracker:
    def step(self, state, scan):
        if state is None:
            x, P = parts.first(scan)
            return (scan.time, x, P, 0), (x, P)
        time, x, P, rejected = state
        x, P = parts.moved(x, P, scan.time - time)
        if scan.valid:
            h, H = parts.expected(x, scan)
            R = scan.noise_covariance
            y = parts.difference(scan.measurement, h, scan)
            S = H @ P @ H.T + R
            if y @ np.linalg.solve(S, y) < GATES[len(y)]:
                rejected = 0
            else:
                rejected += 1
                if rejected > 2:
                    P = P + np.diag([4.0, 4.0, 25.0, 25.0])
                    S = H @ P @ H.T + R
                    rejected = 0
            if rejected == 0:
                x, P = parts.with_gain(x, P, np.linalg.solve(S, H @ P).T, y, H, R)
        P = (P + P.T) / 2
        return (scan.time, x, P, rejected), (x, P)
