"""Sage and Husa: the noise of each sensor is estimated from its residuals, within bounds about what it states."""

import numpy as np
from benchmarks.faults.parts import difference, expected, first, linear_at, moved, updated


class Tracker:
    def __init__(self, forget=0.98, bounds=(0.6, 1.8), after=20):
        self.forget, self.bounds, self.after = forget, bounds, after

    def step(self, state, scan):
        if state is None:
            belief = first(scan)
            return (scan.time, belief, {}), belief
        time, belief, learned = state
        belief = moved(*belief, scan.time - time)
        if scan.valid:
            count, scale = learned.get(scan.sensor, (0, np.ones(len(scan.measurement))))
            belief = self.corrected(*belief, scan, scale)
            learned = {**learned, scan.sensor: (count + 1, self.learned(*belief, scan, count, scale))}
        return (scan.time, belief, learned), belief

    def corrected(self, x, P, scan, scale):
        noise = np.diag(scale * np.diag(scan.noise_covariance))
        x, P = updated(x, P, *linear_at(scan._replace(noise_covariance=noise), x[2:]))
        return x, (P + P.T) / 2

    def learned(self, x, P, scan, count, scale):
        """Variances over those that are stated: a residual after the update lacks what the estimate is wrong by."""
        if count < self.after:
            return scale
        h, H = expected(x, scan)
        gap = difference(scan.measurement, h, scan)
        latest = (gap**2 + np.einsum("ij,jk,ik->i", H, P, H)) / np.diag(scan.noise_covariance)
        share = (1 - self.forget) / (1 - self.forget ** (count + 1))
        return np.clip((1 - share) * scale + share * latest, *self.bounds)
