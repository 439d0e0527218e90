"""Damped Gauss-Newton, of many objects at once."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, Self

import numpy as np

from trackbench.base.types import Array, Gaussian, Mask, some

#: Steps after which a fit that still moves counts as not converged.
MOST_STEPS = 12
#: Length of a step below which a fit has converged, in standard deviations.
CONVERGED = 0.05
#: Share of the sum of squares below which what a step would gain is rounding.
NOTHING = 1e-12
#: Damping at first; it falls by the factor after each step that lowered the cost, and grows by its square after one
#: that did not.
FIRST_DAMPING, DAMPING = 1e-6, 10.0
#: Below this share nothing is damped, so that the covariance is that of the fit.
LEAST_DAMPING = 1e-5


class Fit(NamedTuple):
    """A fit of each object."""

    first: Array
    """``(n, L)`` the state at the first measurement."""
    latest: Gaussian
    """``(n, L)`` the state at the latest."""
    cost: Array
    """``(L,)`` sum of the squares of the normalised residuals."""
    converged: Mask
    """``(L,)``"""


class Unknowns(NamedTuple):
    """What is sought of each object."""

    first: Array
    """``(n, L)`` the state at the first measurement."""
    noise: Array
    """``(K - 1, q, L)`` each driving noise from one measurement to the next, in standard deviations."""

    def part(self, where: Mask) -> Unknowns:
        """That of some objects."""
        return Unknowns(some(self.first, where), some(self.noise, where))

    def moved(self, step: Unknowns) -> Unknowns:
        """That a step away."""
        return Unknowns(self.first + step.first, self.noise + step.noise)


class About(NamedTuple):
    """What is known about a point, of each object."""

    cost: Array
    """``(L,)`` sum of the squares of the normalised residuals."""
    least: Array
    """``(L,)`` what a step would make of it if all were linear."""
    step: Unknowns
    """The damped step of Gauss-Newton."""
    latest: Gaussian
    """``(n, L)`` the state at the latest measurement, with its covariance if nothing were damped."""

    def part(self, where: Mask) -> About:
        """That of some objects."""
        return About(self.cost[where], self.least[where], self.step.part(where), self.latest.part(where))


class SumOfSquares(Protocol):
    """What is to be made small, of each object."""

    def part(self, where: Mask) -> Self:
        """That of some objects."""
        ...

    def about(self, point: Unknowns, damping: Array) -> About:
        """What is known about a point, with a damping ``(L,)``."""
        ...


def searched(squares: SumOfSquares, point: Unknowns) -> Fit:
    """The least sum of squares of each object, looked for from a point; and whether the search came to rest."""
    lanes = np.arange(point.first.shape[-1])
    damping = np.full(lanes.shape, FIRST_DAMPING)
    at = squares.about(point, _used(damping))
    found = Fit(
        np.empty_like(point.first),
        Gaussian(np.empty_like(at.latest.mean), np.empty_like(at.latest.covariance)),
        np.empty_like(at.cost),
        np.empty(lanes.shape, dtype=bool),
    )
    for number in range(1, MOST_STEPS + 1):
        tried, gain = point.moved(at.step), at.cost - at.least
        less = np.maximum(damping / DAMPING, 1e-12)
        there = squares.about(tried, _used(less))
        better = there.cost <= at.cost * (1.0 + 1e-12)
        converged = (gain < CONVERGED**2) & (better | (gain < NOTHING * at.cost))
        damping = np.where(better, less, np.where(converged, damping, np.minimum(damping * DAMPING**2, 1e12)))
        if better.all():
            point, at = tried, there
        else:
            put(point, better, tried.part(better))
            put(at, better, there.part(better))
            again = ~(better | converged)
            if again.any():
                put(at, again, squares.part(again).about(point.part(again), _used(damping[again])))
        done = converged if number < MOST_STEPS else np.ones_like(converged)
        if not done.any():
            continue
        latest = at.latest.part(done)
        if _used(damping[done]).any():
            latest = squares.part(done).about(point.part(done), np.zeros(np.count_nonzero(done))).latest
        rests = converged[done] & np.isfinite(latest.covariance).all(axis=(0, 1))
        put(found, lanes[done], Fit(point.first[:, done], latest, at.cost[done], rests))
        if done.all():
            break
        going = ~done
        squares, point, at = squares.part(going), point.part(going), at.part(going)
        lanes, damping = lanes[going], damping[going]
    return found


def _used(damping: Array) -> Array:
    return np.where(damping < LEAST_DAMPING, 0.0, damping)


def put(whole: Any, where: Any, part: Any) -> None:
    """Put the arrays ``(..., L)`` of some objects into those of all, in place."""
    for old, new in zip(whole, part, strict=True):
        if isinstance(old, np.ndarray):
            old[..., where] = new
        else:
            put(old, where, new)


def index(where: Mask) -> Mask | slice:
    """Of all, a slice: no copy is made."""
    return slice(None) if where.all() else where
