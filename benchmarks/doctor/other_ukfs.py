"""Sound relatives of the unscented Kalman filter, plain NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np

from .plain import Array, Belief, symmetric, wrap
from .plain_ukf import SIZE, PlainUkf, root


class ScaledUkf(PlainUkf):
    """Sigma points with any scaling (Wan and van der Merwe 2000)."""

    def __init__(self, alpha: float = 1e-3, beta: float = 2.0, kappa: float = 0.0, **options: Any) -> None:
        super().__init__(**options)
        self.spread = alpha**2 * (SIZE + kappa)
        first = 1 - SIZE / self.spread
        side = [0.5 / self.spread] * 2 * SIZE
        self.mean_weights = np.array([first, *side])
        self.covariance_weights = np.array([first + 1 - alpha**2 + beta, *side])


class CubatureFilter(PlainUkf):
    """Points on either side alone, with equal weights (Arasaratnam and Haykin 2009).

    They lie sqrt(5) standard deviations away, which is less than half a turn of the course; wrapped to the other side,
    they would leave it uncorrelated with the position for good.
    """

    unknown_angle = 1.2
    mean_weights = np.array([0, *[0.5 / SIZE] * 2 * SIZE])
    covariance_weights = mean_weights


class SquareRootUkf(PlainUkf):
    """Keeps the lower factor of the covariance, by QR (van der Merwe and Wan 2001)."""

    def from_cartesian(self, x: Array, P: Array) -> Belief:
        x, P = super().from_cartesian(x, P)
        return x, root(P)

    def output(self, x: Array, P: Array) -> Belief:
        return super().output(x, P @ P.T)

    def factor(self, P: Array) -> Array:
        return P.T

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        moved = np.array([self.transition(point, dt) for point in self.sigma_points(x, P)])
        mean = self.state_mean(moved, self.mean_weights)
        apart = np.sqrt(self.covariance_weights)[:, None] * self.state_spread(moved, mean)
        mean[3] = wrap(mean[3])
        return mean, lower(np.vstack([apart, root(self.process_noise(x, dt)).T]))

    def corrected_covariance(self, P: Array, K: Array, S: Array) -> Array:
        return root(symmetric(P @ P.T - K @ S @ K.T))


def lower(rows: Array) -> Array:
    """The lower factor L with L L^T = A^T A of rows A."""
    return np.linalg.qr(rows, mode="r").T
