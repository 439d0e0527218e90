"""Damped Gauss-Newton, of many objects at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from trackbench import linalg
from trackbench.engine.equations import Compute
from trackbench.trackers.fit_equations import BEGIN
from trackbench.types import Array, Gaussian, Mask

#: Steps after which a fit that still moves counts as not converged.
MOST_STEPS = 12
#: Length of a step below which a fit has converged, in standard deviations.
CONVERGED = 0.05
#: Share of the sum of squares below which what a step would gain is rounding.
NOTHING = 1e-12
#: Factor by which the damping grows after a step that raised the cost, and falls after one that did not.
DAMPING = 10.0


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


class Sought(Protocol):
    """What is sought of each object: arrays ``(..., L)``."""

    def __iter__(self) -> Any: ...

    def part(self, where: Mask | slice) -> Any: ...

    def moved(self, step: Any) -> Any: ...


class SumOfSquares(Protocol):
    """The sum of squares about a point, and what is known of it: arrays ``(..., L)``."""

    @property
    def cost(self) -> Array: ...

    def __iter__(self) -> Any: ...

    def part(self, where: Mask | slice) -> Any: ...

    def step(self, damping: Array) -> tuple[Any, Array]: ...


P = TypeVar("P", bound=Sought)
S = TypeVar("S", bound=SumOfSquares)


def searched(found: P, about: Callable[[P, Mask | slice], S], steps: int = MOST_STEPS) -> tuple[P, S, Mask]:
    """The least sum of squares of each object, changed in place: the point, what is about it, and where it converged.

    Args:
        found: where the search begins.
        about: the sum of squares about a point of some objects.
        steps: after which a fit that still moves counts as not converged.
    """
    at = about(found, slice(None))
    damping, converged = np.full(at.cost.shape, 1e-6), np.zeros(at.cost.shape, dtype=bool)
    for _ in range(steps):
        moving = index(~converged)
        now = at.part(moving)
        step, gain = now.step(damping[moving])
        tried = found.part(moving).moved(step)
        there = about(tried, moving)
        better = there.cost <= now.cost * (1.0 + 1e-12)
        if isinstance(moving, slice) and better.all():
            found, at = tried, there
        else:
            for whole, new in zip(arrays(found, at), arrays(tried, there), strict=True):
                whole[..., moving] = np.where(better, new, whole[..., moving])
        factor = np.where(better, 1.0 / DAMPING, DAMPING * DAMPING)
        damping[moving] = np.clip(damping[moving] * factor, 1e-12, 1e12)
        converged[moving] = (gain < CONVERGED**2) & (better | (gain < NOTHING * now.cost))
        if converged.all():
            break
    return found, at, converged


def arrays(*collections: Iterable[Any]) -> list[Array]:
    """The arrays among what collections hold."""
    return [item for collection in collections for item in collection if isinstance(item, np.ndarray)]


def damped(information: Array, gradient: Array, damping: Array, compute: Compute) -> Gaussian:
    """The step that an information ``(n, n, L)`` and a gradient ``(n, L)`` say, with its covariance.

    The damping ``(L,)`` is added to the weights of what is sought, as a share of them.
    """
    begun = compute(BEGIN, {"information": information, "damping": damping})
    # Where the information is not positive definite, it tells nothing.
    covariance = np.where(begun["definite"], begun["covariance"], np.nan)
    return Gaussian(linalg.apply(covariance, gradient), covariance)


def index(where: Mask) -> Mask | slice:
    """Of all, a slice: no copy is made."""
    return slice(None) if where.all() else where
