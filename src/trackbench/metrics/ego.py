"""The observer as a vehicle, and the sizes of the objects around it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Observer, Truth

#: Size of an ego that is recorded as a point, m: length and width.
EGO_SIZE = (5.0, 2.0)


class Ego(NamedTuple):
    """The vehicle with the sensors, each ``(...)``."""

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

    @classmethod
    def of(cls, truth: Truth, steps: Indices) -> EgoScene:
        """Return the ego and the sizes of the objects at some of the truth's steps."""
        return cls(Ego.of(truth.observer, steps), truth.length, truth.width)

    def within(self, span: slice) -> EgoScene:
        """At some of the instants."""
        return self._replace(ego=self.ego.each(span))
