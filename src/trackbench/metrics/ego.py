"""The ego vehicle that carries the sensors, and the sizes of the objects around it."""

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
    """Vehicle that carries the sensors: its size, and arrays of its motion with one common shape."""

    @classmethod
    def of(cls, observer: Observer, steps: Indices | slice) -> Ego:
        """Return the ego vehicle at some steps of the truth; a vehicle without a recorded size gets 5 m by 2 m."""
        motion = {name: getattr(observer, name)[steps] for name in _MOTION}
        return cls(**motion, length=observer.length or EGO_SIZE[0], width=observer.width or EGO_SIZE[1])

    def each(self, pick: Any) -> Ego:
        """Return the vehicle with each array of its motion indexed by ``pick``, such as ``(slice(None), None)``."""
        return replace(self, **{name: getattr(self, name)[pick] for name in _MOTION})

    @property
    def speed(self) -> Array:
        return np.hypot(self.vx, self.vy)


class EgoScene(NamedTuple):
    """Motion of the vehicle that carries the sensors, at the scored instants, and sizes of the objects."""

    ego: Ego
    """Motion of the vehicle that carries the sensors, arrays ``(instants,)``."""
    length: Array
    """``(objects,)`` length of each object's body, m."""
    width: Array

    @classmethod
    def of(cls, truth: Truth, steps: Indices) -> EgoScene:
        """Return the ego and the sizes of the objects at some of the truth's steps."""
        return cls(Ego.of(truth.observer, steps), truth.length, truth.width)

    def within(self, span: slice) -> EgoScene:
        """Return the scene at the instants that the slice ``span`` selects."""
        return self._replace(ego=self.ego.each(span))
