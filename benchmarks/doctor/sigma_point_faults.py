"""Faults of the weights, points and noise of an unscented filter: methods and attributes that override correct ones."""

from __future__ import annotations

from typing import Any

import numpy as np

from .plain import Array, Belief
from .plain_ukf import SIZE, root


class PlainSums:
    """The mean is the weighted sum of the points, as it is written in the books."""

    def state_mean(self, points: Array, weights: Array) -> Array:
        return weights @ points

    def measurement_mean(self, kind: str, points: Array, weights: Array) -> Array:
        return weights @ points


class EqualWeights(PlainSums):
    """1 / 2n for the centre too: a sum of 1.1."""

    mean_weights = covariance_weights = np.full(2 * SIZE + 1, 0.5 / SIZE)


class CentreLeftOut(PlainSums):
    """Points of lambda = 3 - n without the centre, whose weight is negative: a sum of 5 / 3."""

    spread = 3.0
    mean_weights = covariance_weights = np.array([0, *[0.5 / 3] * 2 * SIZE])


class CovarianceWeightsForMean(PlainSums):
    """The centre's weight has beta in it: a sum of 3."""

    mean_weights = np.array([2, *[0.5 / SIZE] * 2 * SIZE])


class OtherKappa:
    """Points of kappa = 3 - n, weights of kappa = 0."""

    spread = 3.0


class RootForgotten:
    """The points lie n + lambda away instead of its square root."""

    spread = float(SIZE**2)


class SpreadForgotten:
    """The points lie one standard deviation away, whatever n + lambda is."""

    spread = 1.0


class OtherKappaInUpdate:
    """Points of kappa = 3 - n and weights of kappa = 0, in the update alone."""

    def points_for_update(self, x: Array, P: Array) -> Array:
        rows = np.sqrt(3.0) * self.factor(P)
        return np.vstack([x, x + rows, x - rows])


class RowsForColumns:
    """The rows of the lower Cholesky factor, whose columns are meant."""

    def factor(self, P: Array) -> Array:
        return root(P)


class NotRedrawn:
    """The update goes on with the moved points, in which the process noise is missing."""

    moved: Array

    def predict(self, x: Array, P: Array, dt: float) -> Belief:
        self.moved = np.array([self.transition(point, dt) for point in self.sigma_points(x, P)])
        return super().predict(x, P, dt)

    def points_for_update(self, x: Array, P: Array) -> Array:
        return self.moved


class NoiseOmitted:
    """The innovation covariance without the measurement noise."""

    def added_noise(self, scan: Any) -> Array:
        return np.zeros_like(scan.noise_covariance)


class NoiseTwice:
    """The measurement noise of a radar added to the innovation covariance twice."""

    def added_noise(self, scan: Any) -> Array:
        return (2 if scan.kind == "radar" else 1) * scan.noise_covariance


class ProcessNoiseOmitted:
    """The predicted covariance is that of the moved points alone."""

    def process_noise(self, x: Array, dt: float) -> Array:
        return np.zeros((SIZE, SIZE))
