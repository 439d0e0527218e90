"""An iterated extended filter: the update minimises the squared deviations by Levenberg and Marquardt's steps."""

import numpy as np
from benchmarks.faults.parts import Filter, difference, expected


class Tracker(Filter):
    steps = 6

    def corrected(self, x, P, scan):
        prior, noise = np.linalg.inv(P), np.linalg.inv(scan.noise_covariance)

        def cost(y):
            d, e = y - x, difference(scan.measurement, expected(y, scan)[0], scan)
            return d @ prior @ d + e @ noise @ e

        y, damping, now = x.copy(), 1e-3, cost(x)
        for _ in range(self.steps):
            h, H = expected(y, scan)
            slope = H.T @ noise @ difference(scan.measurement, h, scan) + prior @ (x - y)
            curvature = prior + H.T @ noise @ H
            trial = y + np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), slope)
            then = cost(trial)
            if then < now:
                y, now, damping = trial, then, damping / 10
            else:
                damping *= 10
        _, H = expected(y, scan)
        P = np.linalg.inv(prior + H.T @ noise @ H)
        return y, (P + P.T) / 2
