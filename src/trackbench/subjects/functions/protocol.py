"""What a driver assistance function is, what it gets, and what it decides."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from trackbench.base.config import Config
from trackbench.base.plugins import Registry, lacks_class
from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.ego import Ego

#: In place of the column of an object: none was chosen.
NO_OBJECT = -1
#: Size of an object of which nothing is known, m: length and width.
NOMINAL_SIZE = (4.5, 1.8)


class Objects(NamedTuple):
    """K objects: tracks, or the truth with covariance 0. Values where one is not there are finite and mean nothing."""

    mean: Array
    """``(4, K, ...)`` px, py, vx, vy in the fixed frame."""
    covariance: Array
    """``(4, 4, K, ...)``"""
    there: Mask
    """``(K, ...)``"""
    length: Array
    """``(K, ...)`` m, as ``width``; axes may have length 1."""
    width: Array


class Decision(NamedTuple):
    """What a function decides, each ``(...)``."""

    active: Mask
    """Whether it warns or acts."""
    object: Indices
    """Column of the object that it is about; -1 where there is none."""
    quantity: Array
    """What it has computed of that object; NaN where there is none."""


class Quantity(NamedTuple):
    """What a function computes of an object."""

    name: str
    """Of the metric of its error, before ``_error``."""
    unit: str
    meaning: str


class Function(Config, ABC):
    """A function. It is stateless: its fields are its options in a scenario, and each instant is decided by itself."""

    quantity: ClassVar[Quantity]
    chooses_lead: ClassVar[bool] = False
    """Whether it always has a lead that a wrong one is compared with."""
    brakes: ClassVar[bool] = False
    """Whether its quantity is the deceleration that it commands while active."""

    use: str = Field("", description="The function, or one of your own as `module:Class`.")
    probability: float = Field(
        0.5,
        gt=0,
        lt=1,
        description="It is active where its condition holds with more than this probability, given the covariance.",
    )

    @abstractmethod
    def decide(self, ego: Ego, objects: Objects) -> Decision:
        """Decide for every ``(...)`` by itself.

        Args:
            ego: the arrays ``(...)``; axes may have length 1.
            objects: tracks or the truth.
        """


def decision(possible: Mask, probability: Array, least: float, order: Array, quantity: Array) -> Decision:
    """The decision from what is known of each object.

    Active where the condition holds of any object with more than the ``least`` probability. Its object is the first of
    those by ``order``, or else the first of the possible ones.

    Args:
        possible: ``(K, ...)`` objects that are looked at while the condition holds of none.
        probability: ``(K, ...)`` that the condition holds.
        least: below which it does not count.
        order: ``(K, ...)`` the smallest is first.
        quantity: ``(K, ...)``
    """
    if not len(possible):
        shape = possible.shape[1:]
        return Decision(np.zeros(shape, dtype=bool), np.full(shape, NO_OBJECT), np.full(shape, np.nan))
    holds = probability > least
    active = np.asarray(holds.any(axis=0))
    eligible = np.where(active, holds, possible)
    first = np.argmin(np.where(eligible, order, np.inf), axis=0)
    some = eligible.any(axis=0)
    chosen = np.take_along_axis(np.broadcast_to(quantity, possible.shape), first[None], axis=0)[0]
    return Decision(active, np.where(some, first, NO_OBJECT), np.where(some, chosen, np.nan))


#: The functions that a scenario can name.
FUNCTIONS: Registry[type[Function]] = Registry("trackbench.functions", "function", lacks_class(Function))
