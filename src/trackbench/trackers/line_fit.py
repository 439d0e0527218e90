"""The straight line without driving noise that a few measurements say, by Gauss-Newton."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Gaussian, Mask, some
from trackbench.engine.equations import Compute
from trackbench.trackers.first_measurements import FirstMeasurements
from trackbench.trackers.fit_equations import ALONG, LOWER, on_line
from trackbench.trackers.fit_search import About, Fit, Unknowns, searched


def fit_line(first: Array, measurements: FirstMeasurements, velocity_sigma: float, compute: Compute) -> Fit:
    """The most probable straight line at constant velocity.

    Args:
        first: ``(4, L)`` px, py, vx, vy at the first measurement where the search begins.
        measurements: of L objects.
        velocity_sigma: standard deviation of either component of a velocity whose mean is zero, m/s.
        compute: how equations are computed.
    """
    lanes = first.shape[-1]
    elapsed = np.concatenate([np.zeros((1, lanes)), np.cumsum(measurements.interval, axis=0)])
    undriven = Unknowns(first.copy(), np.zeros((0, 0, lanes)))
    return searched(_Line(elapsed, measurements, 1.0 / velocity_sigma**2, compute), undriven)


class _Line(NamedTuple):
    """The sum of squares of a straight line."""

    elapsed: Array
    """``(K, L)`` from the first measurement to each, s."""
    measurements: FirstMeasurements
    slow: float
    """Weight of the square of a velocity."""
    compute: Compute

    def part(self, where: Mask) -> _Line:
        return self._replace(elapsed=some(self.elapsed, where), measurements=self.measurements.part(where))

    def about(self, point: Unknowns, damping: Array) -> About:
        first, equations = point.first, on_line(self.measurements.kinds)
        told = np.zeros((1 + 4 + len(LOWER), first.shape[-1]))
        told[0] = self.slow * (first[2] ** 2 + first[3] ** 2)
        told[3:5] = -self.slow * first[2:]
        for place, (i, j) in enumerate(LOWER):
            if i == j and i > 1:
                told[5 + place] = self.slow
        for k, elapsed in enumerate(self.elapsed):
            given = {"told": told, "first": first, "elapsed": elapsed, **self.measurements.at(k)}
            told = self.compute(equations, given)["told"]
        given = {"told": told, "first": first, "elapsed": self.elapsed[-1], "damping": damping}
        said = self.compute(ALONG, given)
        covariance = np.where(said["definite"], said["covariance"], np.nan)
        step = np.where(said["definite"], said["mean"], np.nan)
        return About(told[0], said["least"], Unknowns(step, point.noise), Gaussian(said["x"], covariance))
