"""The path of the ego, and objects in its coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from trackbench.base.types import Array
from trackbench.metrics.ego import Ego
from trackbench.subjects.functions.protocol import Objects

#: Below this speed the path is taken to be straight on, m/s: the quotient of two small rates means nothing.
STANDING = 0.5
#: Curvature of a straight path: its coordinates differ from those of a line by less than rounding, 1/m.
STRAIGHT = 1e-12
#: A time that is not shorter is this one, s: how far away what is far away is does not matter.
LONGEST = 10.0


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
    return np.where(certain, margin > 0, ndtr(margin / np.where(certain, 1.0, sigma)))


def time_until(distance: Array, speed: Array) -> Array:
    """``(...)`` s until a distance is covered: 0 where it is no longer there, ``LONGEST`` at most."""
    moves = speed > 0
    time = np.where(moves, np.maximum(distance, 0.0) / np.where(moves, speed, 1.0), LONGEST)
    return np.minimum(time, LONGEST)
