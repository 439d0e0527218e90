"""Variational Bayes: the variance of each component of each sensor is estimated along with the state.

Inverse gamma distributions of how much larger than stated it is; they start at 1 and forget slowly.
"""

import numpy as np
from benchmarks.faults.parts import difference, expected, first, linear_at, moved, updated


class Tracker:
    memory, start, rounds = 400.0, 60.0, 3

    def step(self, state, scan):
        if state is None:
            x, P = first(scan)
            return (scan.time, x, P, {}), (x, P)
        time, x, P, gammas = state
        x, P = moved(x, P, scan.time - time)
        if scan.valid:
            m = len(scan.measurement)
            a, b = gammas.get(scan.sensor, (np.full(m, self.start), np.full(m, self.start)))
            x, P, found = self.joint(x, P, a, b, scan)
            gammas = {**gammas, scan.sensor: found}
        return (scan.time, x, P, gammas), (x, P)

    def joint(self, x, P, a, b, scan):
        forget = min(1.0, self.memory / (a[0] + 0.5))
        a, b = forget * a, forget * b
        stated = np.diag(scan.noise_covariance)
        after = a + 0.5
        scale = b / a
        for _ in range(self.rounds):
            assumed = scan._replace(noise_covariance=np.diag(scale * stated))
            mean, C = updated(x, P, *linear_at(assumed, x[2:]))
            h, H = expected(mean, scan)
            gap = difference(scan.measurement, h, scan)
            total = b + (gap**2 + np.einsum("ij,jk,ik->i", H, C, H)) / (2 * stated)
            scale = total / after
        return mean, (C + C.T) / 2, (after, total)
