"""The observer as a vehicle, and the sizes of the objects around it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Observer, Truth

#: Size of an ego that is recorded as a point, m: length and width.
EGO_SIZE = (5.0, 2.0)
_MOTION = ("px", "py", "yaw", "vx", "vy", "yaw_rate")


@dataclass(frozen=True)
class Ego(Observer):
    """The vehicle with the sensors; its arrays are ``(...)``."""

    @classmethod
    def of(cls, observer: Observer, steps: Indices | slice) -> Ego:
        """The observer at some steps of the truth; ``EGO_SIZE`` where it is a point."""
        motion = {name: getattr(observer, name)[steps] for name in _MOTION}
        return cls(**motion, length=observer.length or EGO_SIZE[0], width=observer.width or EGO_SIZE[1])

    def each(self, pick: Any) -> Ego:
        """With ``pick`` as an index of every array, such as ``(slice(None), None)``."""
        return replace(self, **{name: getattr(self, name)[pick] for name in _MOTION})

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
