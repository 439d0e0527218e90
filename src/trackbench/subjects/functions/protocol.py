"""The interface of a driver assistance function: its input, its decision and its base class."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from trackbench.base.config import Config
from trackbench.base.plugins import Registry, lacks_class
from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.ego import Ego

#: Column of the chosen object where none was chosen.
NO_OBJECT = -1
#: Assumed length and width of an object of unknown size, m.
NOMINAL_SIZE = (4.5, 1.8)


class Objects(NamedTuple):
    """K objects: tracks, or true objects with covariance 0. Values of an absent object are finite and meaningless."""

    mean: Array
    """px, py, vx, vy in the fixed frame, ``(4, K, ...)``."""
    covariance: Array
    """Covariance of the mean, ``(4, 4, K, ...)``."""
    there: Mask
    """Whether an object is present, ``(K, ...)``."""
    length: Array
    """Length of each object, m, ``(K, ...)``; axes of one element are broadcast. ``width`` has the same form."""
    width: Array


class Decision(NamedTuple):
    """Decision of a driver assistance function: whether it acts, on which object, by which quantity; each ``(...)``."""

    active: Mask
    """Whether the function warns or acts."""
    object: Indices
    """Index among the K objects of the object that the decision is about; -1 where there is none."""
    quantity: Array
    """Value of the function's quantity for that object; NaN where there is none."""


class Quantity(NamedTuple):
    """Quantity that a function computes for an object, such as the time to collision."""

    name: str
    """Name of the quantity; the metric of the quantity's error has this name with the ending ``_error``."""
    unit: str
    meaning: str


class Function(Config, ABC):
    """Base class of assistance functions, which are stateless; the fields are the function's options in a scenario."""

    quantity: ClassVar[Quantity]
    chooses_lead: ClassVar[bool] = False
    """Whether the function always chooses a lead, which is compared with the true lead."""
    brakes: ClassVar[bool] = False
    """Whether the function's quantity is the deceleration that it commands while active."""

    use: str = Field("", description="The function, or one of your own as `module:Class`.")
    probability: float = Field(
        0.5,
        gt=0,
        lt=1,
        description="It is active where its condition holds with more than this probability, given the covariance.",
    )

    @abstractmethod
    def decide(self, ego: Ego, objects: Objects) -> Decision:
        """Return the decision at each instant of each run, which depends on the motion at that instant alone.

        Args:
            ego: motion of the ego, arrays ``(...)``; axes may have length 1.
            objects: tracks or true objects.
        """


def decision(possible: Mask, probability: Array, least: float, order: Array, quantity: Array) -> Decision:
    """Return the decision on K objects.

    The function is active where the condition holds for some object with more than the ``least`` probability. The
    decision is about the first such object in ``order``; without such objects, about the first possible object.

    Args:
        possible: objects that the decision may be about while inactive, ``(K, ...)``.
        probability: probability that the condition holds, ``(K, ...)``.
        least: probability that must be exceeded.
        order: sort key of the objects, smallest first, ``(K, ...)``.
        quantity: value of the function's quantity, ``(K, ...)``.
    """
    if not len(possible):
        shape = possible.shape[1:]
        return Decision(np.zeros(shape, dtype=bool), np.full(shape, NO_OBJECT), np.full(shape, np.nan))
    holds = probability > least
    active = np.asarray(holds.any(axis=0))
    eligible = np.where(active, holds, possible)
    first = np.argmin(np.where(eligible, order, np.inf), axis=0)
    has_object = eligible.any(axis=0)
    chosen = np.take_along_axis(np.broadcast_to(quantity, possible.shape), first[None], axis=0)[0]
    return Decision(active, np.where(has_object, first, NO_OBJECT), np.where(has_object, chosen, np.nan))


#: Functions that a scenario can name.
FUNCTIONS: Registry[type[Function]] = Registry("trackbench.functions", "function", lacks_class(Function))
