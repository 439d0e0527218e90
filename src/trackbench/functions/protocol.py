"""What a driver assistance function is, what it gets and decides, and the path of the ego with objects beside it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from trackbench.base.config import Config
from trackbench.base.distributions import normal_below
from trackbench.base.plugins import Registry, lacks_class
from trackbench.base.types import Array, Indices, Mask, Observer

#: Below this speed the path is taken to be straight on, m/s: the quotient of two small rates means nothing.
STANDING = 0.5
#: Curvature of a straight path: its coordinates differ from those of a line by less than rounding, 1/m.
STRAIGHT = 1e-12
#: A time that is not shorter is this one, s: how far away what is far away is does not matter.
LONGEST = 10.0
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


class OnPath(NamedTuple):
    """Objects in coordinates along and across the path of the ego, an arc of constant curvature. Each ``(K, ...)``."""

    along: Array
    """From the ego's centre, along the arc, to the object's, m."""
    across: Array
    """m, to the left."""
    speed: Array
    """Of the object in the direction of the path beside it, m/s."""
    lateral_speed: Array
    """m/s, to the left."""
    direction: tuple[Array, Array]
    """Cosine and sine of the direction of the path beside it, in the fixed frame."""
    stretch: Array
    """How many times longer the way beside the object is than the path: below 1 on the inner side of a curve."""
    turn: Array
    """By how much the direction of the path changes per metre of the object's way, rad/m."""
    covariance: Array
    """``(4, 4, K, ...)`` of the state."""
    lengths: Array
    """Half of the lengths of both: where the centres are so far apart along the path they touch, m."""
    widths: Array
    """Half of the widths of both, m."""

    @property
    def gap(self) -> Array:
        """From the front of the ego to the rear of an object ahead, m."""
        return self.along - self.lengths

    def gradient(self, partials: Sequence[Array | float]) -> Array:
        """``(4, K, ...)`` derivatives by the state, of a margin with these by along, across, speed and lateral
        speed."""
        along, across, speed, lateral = partials
        c, s = self.direction
        ahead = along / self.stretch + self.turn * (speed * self.lateral_speed - lateral * self.speed)
        rows = ahead * c - across * s, ahead * s + across * c, speed * c - lateral * s, speed * s + lateral * c
        return np.stack(rows)

    def variance(self, partials: Sequence[Array | float]) -> Array:
        """``(K, ...)`` of a margin with these partial derivatives, to first order."""
        gradient = self.gradient(partials)
        return np.asarray(np.einsum("a...,ab...,b...->...", gradient, self.covariance, gradient))

    def probability_within(self, offset: Array | float = 0.0, after: float = 0.0) -> Array:
        """``(K, ...)`` that an object overlaps in width a path ``offset`` m to the left, ``after`` so many seconds."""
        across = self.across + after * self.lateral_speed - offset
        variance = self.variance((0.0, 1.0, 0.0, after))
        return probability_positive(self.widths - across, variance) - probability_positive(
            -self.widths - across, variance
        )


def on_path(ego: Ego, objects: Objects) -> OnPath:
    """Objects along and across the path of the ego.

    The path begins in the direction in which the ego moves, with the curvature k = yaw rate / speed. Of an object at
    (x, y) ahead and to the left of the ego: rho = |(k x, 1 - k y)|, across = (2 y - k (x^2 + y^2)) / (1 + rho), along =
    atan2(k x, 1 - k y) / k. The objects are taken to be aligned with the path.
    """
    speed = ego.speed
    moves = speed > STANDING
    direction = np.where(moves, np.arctan2(ego.vy, ego.vx), ego.yaw)
    curvature = np.where(moves, ego.yaw_rate / np.where(moves, speed, 1.0), 0.0)
    curvature = np.where(np.abs(curvature) < STRAIGHT, STRAIGHT, curvature)
    dx, dy = objects.mean[0] - ego.px, objects.mean[1] - ego.py
    x, y = np.cos(direction) * dx + np.sin(direction) * dy, np.cos(direction) * dy - np.sin(direction) * dx
    turned = np.arctan2(curvature * x, 1.0 - curvature * y)
    rho = np.maximum(np.hypot(curvature * x, 1.0 - curvature * y), STRAIGHT)
    c, s = np.cos(direction + turned), np.sin(direction + turned)
    vx, vy = objects.mean[2:]
    return OnPath(
        along=turned / curvature,
        across=(2.0 * y - curvature * (x * x + y * y)) / (1.0 + rho),
        speed=c * vx + s * vy,
        lateral_speed=c * vy - s * vx,
        direction=(c, s),
        stretch=rho,
        turn=curvature / rho,
        covariance=objects.covariance,
        lengths=(ego.length + objects.length) / 2,
        widths=(ego.width + objects.width) / 2,
    )


def probability_positive(margin: Array, variance: Array) -> Array:
    """``(...)`` that a normal variable with this mean and variance is above 0; without variance 1 or 0."""
    sigma = np.sqrt(np.maximum(variance, 0.0))
    certain = sigma == 0.0
    return np.where(certain, margin > 0, normal_below(margin / np.where(certain, 1.0, sigma)))


def time_until(distance: Array, speed: Array) -> Array:
    """``(...)`` s until a distance is covered: 0 where it is no longer there, ``LONGEST`` at most."""
    moves = speed > 0
    time = np.where(moves, np.maximum(distance, 0.0) / np.where(moves, speed, 1.0), LONGEST)
    return np.minimum(time, LONGEST)


#: The functions that a scenario can name.
FUNCTIONS: Registry[type[Function]] = Registry("trackbench.functions", "function", lacks_class(Function))
