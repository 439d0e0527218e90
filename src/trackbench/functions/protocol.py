"""What a driver assistance function is, what it gets, and what it decides."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from trackbench.base.config import Config
from trackbench.base.plugins import Registry, lacks_class
from trackbench.base.types import Array, Indices, Mask, Observer

#: In place of the column of an object: none was chosen.
NO_OBJECT = -1
#: Size of an ego that is recorded as a point, and of an object of which nothing is known, m: length and width.
EGO_SIZE, NOMINAL_SIZE = (5.0, 2.0), (4.5, 1.8)


class Ego(NamedTuple):
    """The vehicle with the function, each ``(...)``."""

    px: Array
    """Of its centre, m."""
    py: Array
    yaw: Array
    """rad"""
    vx: Array
    """m/s"""
    vy: Array
    yaw_rate: Array
    """rad/s"""
    length: float
    """m"""
    width: float

    @classmethod
    def of(cls, observer: Observer, steps: Indices | slice) -> Ego:
        """The observer at some steps of the truth; ``EGO_SIZE`` where it is a point."""
        at = observer
        length, width = at.length or EGO_SIZE[0], at.width or EGO_SIZE[1]
        return cls(at.px, at.py, at.yaw, at.vx, at.vy, at.yaw_rate, length, width).each(steps)

    def each(self, pick: Any) -> Ego:
        """With ``pick`` as an index of every array, such as ``(slice(None), None)``."""
        motion = {name: values[pick] for name, values in zip(self._fields[:6], self[:6], strict=True)}
        return self._replace(**motion)

    @property
    def speed(self) -> Array:
        """m/s"""
        return np.hypot(self.vx, self.vy)


class EgoScene(NamedTuple):
    """The ego and the sizes of the objects of the truth, at the instants at which trackers are scored."""

    ego: Ego
    """``(instants,)``"""
    length: Array
    """``(objects,)`` m, as ``width``."""
    width: Array

    def within(self, span: slice) -> EgoScene:
        """At some of the instants."""
        return self._replace(ego=self.ego.each(span))


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
