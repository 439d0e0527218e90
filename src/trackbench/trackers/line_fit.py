"""The straight line without driving noise that a few measurements say, by Gauss-Newton."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench import linalg
from trackbench.engine.equations import Compute
from trackbench.trackers.first_measurements import FirstMeasurements, places
from trackbench.trackers.fit_equations import LOWER, on_line
from trackbench.trackers.fit_search import Fit, damped, searched
from trackbench.types import Array, Gaussian, Mask


def fit_line(first: Array, measurements: FirstMeasurements, velocity_sigma: float, compute: Compute) -> Fit:
    """The most probable straight line at constant velocity.

    Args:
        first: ``(4, L)`` px, py, vx, vy at the first measurement where the search begins.
        measurements: of L objects.
        velocity_sigma: standard deviation of either component of a velocity whose mean is zero, m/s.
        compute: how equations are computed.
    """
    elapsed = np.concatenate([np.zeros((1, first.shape[-1])), np.cumsum(measurements.interval, axis=0)])

    def about(point: _Point, where: Mask | slice) -> _Sums:
        return _Sums.of(point.first, elapsed[:, where], measurements.part(where), velocity_sigma, compute)

    found, at, converged = searched(_Point(first.copy()), about)
    covariance = damped(at.information, at.gradient, np.zeros_like(at.cost), compute).covariance
    latest = elapsed[-1]
    zero, one = np.zeros_like(latest), np.ones_like(latest)
    reach = linalg.matrix(
        [[one, zero, latest, zero], [zero, one, zero, latest], [zero, zero, one, zero], [zero] * 3 + [one]]
    )
    covariance = linalg.symmetrise(linalg.quadratic(reach, covariance))
    finite = np.isfinite(covariance).all(axis=(0, 1))
    return Fit(found.first, Gaussian(linalg.apply(reach, found.first), covariance), at.cost, converged & finite)


class _Point(NamedTuple):
    """What is sought."""

    first: Array
    """``(4, L)`` the first state."""

    def part(self, where: Mask | slice) -> _Point:
        """That of some objects."""
        return _Point(self.first[:, where])

    def moved(self, step: _Point) -> _Point:
        """That a step away."""
        return _Point(self.first + step.first)


class _Sums(NamedTuple):
    """The sum of squares about a line."""

    cost: Array
    """``(L,)``"""
    gradient: Array
    """``(4, L)`` by the first state, downhill."""
    information: Array
    """``(4, 4, L)`` of the first state."""
    compute: Compute

    def part(self, where: Mask | slice) -> _Sums:
        """That of some objects."""
        return _Sums(self.cost[where], self.gradient[:, where], self.information[..., where], self.compute)

    @classmethod
    def of(
        cls, first: Array, elapsed: Array, measurements: FirstMeasurements, velocity_sigma: float, compute: Compute
    ) -> _Sums:
        weight = 1.0 / velocity_sigma**2
        told = np.zeros((1 + 4 + len(LOWER), first.shape[-1]))
        told[0] = weight * (first[2] ** 2 + first[3] ** 2)
        told[3:5] = -weight * first[2:]
        for place, (i, j) in enumerate(LOWER):
            if i == j and i > 1:
                told[5 + place] = weight
        for number, sensor in enumerate(measurements.kinds):
            at = places(measurements.kind == number)
            size, (k, lane) = len(sensor.components), at
            given = {
                "first": first[:, None] if isinstance(lane, slice) else first[:, lane],
                "elapsed": elapsed[at],
                "value": measurements.value[:size, k, lane],
                "whitener": measurements.whitener[:size, :size, k, lane],
                "pose": measurements.pose[:, k, lane],
                "velocity": measurements.velocity[:, k, lane],
            }
            each = compute(on_line(sensor), given)["told"]
            if not isinstance(lane, slice):
                own, each = each, np.zeros((len(told), *elapsed.shape))
                each[:, k, lane] = own
            told += each.sum(axis=1)
        information = np.empty((4, 4, first.shape[-1]))
        for (i, j), row in zip(LOWER, told[5:], strict=True):
            information[i, j] = information[j, i] = row
        return cls(told[0], told[1:5], information, compute)

    def step(self, damping: Array) -> tuple[_Point, Array]:
        """A damped step of Gauss-Newton, and by how much it would lower the sum of squares if all were linear."""
        mean = damped(self.information, self.gradient, damping, self.compute).mean
        return _Point(mean), np.einsum("i...,i...->...", self.gradient, mean)
