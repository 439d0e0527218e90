"""An unscented Kalman filter with constant velocity and narrow sigma points, plain NumPy.

With alpha 0.1, beta 2 and kappa -1 (van der Merwe 2004) the weight of the central point is -132 of the mean and -129 of
the covariance: a wrong mean can cost the covariance its definiteness, and `cholesky` then raises.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .plain import Array, Belief, symmetric
from .plain_ekf import ConstantVelocity

SIZE = 4
ALPHA, BETA, KAPPA = 0.1, 2.0, -1.0
SCALE = ALPHA**2 * (SIZE + KAPPA)


class CholeskyUkf(ConstantVelocity):
    """Radar and lidar of one target."""

    mean_weights = np.array([1 - SIZE / SCALE, *[0.5 / SCALE] * 2 * SIZE])
    covariance_weights = mean_weights + (1 - ALPHA**2 + BETA) * (np.arange(2 * SIZE + 1) == 0)

    def update(self, x: Array, P: Array, scan: Any) -> Belief:
        columns = np.sqrt(SCALE) * np.linalg.cholesky(P).T
        points = np.vstack([x, x + columns, x - columns])
        seen = np.array([self.predicted_measurement(point, scan) for point in points])
        mean = self.measurement_mean(scan.kind, seen, self.mean_weights)
        apart = self.measurement_spread(scan.kind, seen, mean)
        S = symmetric(apart.T * self.covariance_weights @ apart) + self.noise(scan)
        cross = (points - x).T * self.covariance_weights @ self.cross_spread(scan.kind, seen, mean)
        K = np.linalg.solve(S, cross.T).T
        return self.corrected(x, P, K, self.innovation(scan, mean), S)

    def measurement_mean(self, kind: str, points: Array, weights: Array) -> Array:
        return points[0] + weights @ self.measurement_spread(kind, points, points[0])

    def measurement_spread(self, kind: str, points: Array, centre: Array) -> Array:
        return np.array([self.residual(kind, point, centre) for point in points])

    def cross_spread(self, kind: str, points: Array, centre: Array) -> Array:
        return self.measurement_spread(kind, points, centre)
