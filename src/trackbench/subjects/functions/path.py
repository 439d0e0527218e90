"""The path of the ego, and the coordinates of objects along it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from trackbench.base.types import Array
from trackbench.metrics.ego import Ego
from trackbench.subjects.functions.protocol import Objects

#: Speed below which the path is assumed to be straight, m/s, since yaw rate over speed is then meaningless.
STANDING = 0.5
#: Curvature used for a straight path, 1/m; its coordinates equal a line's up to rounding.
STRAIGHT = 1e-12
#: Largest time that is returned, s, since differences of long times do not matter.
LONGEST = 10.0


class OnPath(NamedTuple):
    """Coordinates of objects along and across the ego's path, an arc of constant curvature; arrays ``(K, ...)``."""

    along: Array
    """Distance from the ego's centre to the object's centre, along the arc, m."""
    across: Array
    """Distance from the path, m: positive to the left."""
    speed: Array
    """Speed of the object along the path, by the path's direction at the point nearest to the object, m/s."""
    lateral_speed: Array
    """Speed of the object across the path, m/s: positive to the left."""
    direction: tuple[Array, Array]
    """Cosine and sine of the path's direction at the point nearest to the object, in the fixed frame."""
    stretch: Array
    """Ratio of a way at the object's lateral distance to the way along the path: below 1 inside a curve."""
    turn: Array
    """Turn of the path's direction for each metre that the object travels, rad/m; beside a path it is not the
    path's curvature."""
    covariance: Array
    """Covariance of the object's px, py, vx, vy, ``(4, 4, K, ...)``."""
    lengths: Array
    """Half the sum of both lengths: the distance of the centres along the path at which the bodies touch, m."""
    widths: Array
    """Half the sum of both widths, m."""

    @property
    def gap(self) -> Array:
        """Distance from the ego's front to the rear of an object ahead, m."""
        return self.along - self.lengths

    def gradient(self, partials: Sequence[Array | float]) -> Array:
        """Return a margin's derivatives with respect to px, py, vx, vy, ``(4, K, ...)``.

        ``partials`` are its derivatives with respect to ``along``, ``across``, ``speed`` and ``lateral_speed``.
        """
        along, across, speed, lateral = partials
        c, s = self.direction
        ahead = along / self.stretch + self.turn * (speed * self.lateral_speed - lateral * self.speed)
        rows = ahead * c - across * s, ahead * s + across * c, speed * c - lateral * s, speed * s + lateral * c
        return np.stack(rows)

    def variance(self, partials: Sequence[Array | float]) -> Array:
        """Return a margin's variance ``(K, ...)``, to first order, from the partial derivatives of :meth:`gradient`."""
        gradient = self.gradient(partials)
        return np.asarray(np.einsum("a...,ab...,b...->...", gradient, self.covariance, gradient))

    def probability_within(self, offset: Array | float = 0.0, after: float = 0.0) -> Array:
        """Return the probability ``(K, ...)`` that objects overlap the path in width ``after`` s from now.

        The path is first moved ``offset`` m to the left.
        """
        across = self.across + after * self.lateral_speed - offset
        variance = self.variance((0.0, 1.0, 0.0, after))
        return probability_positive(self.widths - across, variance) - probability_positive(
            -self.widths - across, variance
        )


def on_path(ego: Ego, objects: Objects) -> OnPath:
    """Return the coordinates of objects along and across the ego's path.

    The path begins in the ego's direction of motion, with curvature k = yaw rate / speed. For an object at (x, y),
    ahead and to the left of the ego: rho = |(k x, 1 - k y)|, across = (2 y - k (x^2 + y^2)) / (1 + rho) and along =
    atan2(k x, 1 - k y) / k. Objects are assumed to be aligned with the path.
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
    """Return the probability ``(...)`` that a normal variable of mean ``margin`` is positive."""
    sigma = np.sqrt(np.maximum(variance, 0.0))
    certain = sigma == 0.0
    return np.where(certain, margin > 0, ndtr(margin / np.where(certain, 1.0, sigma)))


def time_until(distance: Array, speed: Array) -> Array:
    """Return the time, s ``(...)``, to cover a distance: 0 for none, and at most ``LONGEST``."""
    moves = speed > 0
    time = np.where(moves, np.maximum(distance, 0.0) / np.where(moves, speed, 1.0), LONGEST)
    return np.minimum(time, LONGEST)
