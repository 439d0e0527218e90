"""Vehicles that hide those behind them."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Indices, Mask, Truth

#: Lines of sight that are held at a time.
CHUNK = 200_000
#: Points of a box that are looked at, in half lengths and half widths: its centre and its corners.
POINTS = np.array([(0, 0), (1, 1), (1, -1), (-1, -1), (-1, 1)], dtype=float)


def occluded(truth: Truth, steps: Indices, origin: Array) -> Mask:
    """Whether other objects hide an object: their boxes cross the lines of sight to its centre and its corners.

    Args:
        truth: the motion, and the sizes.
        steps: ``(instants,)`` of the truth.
        origin: ``(2, instants)`` x, y where the sensor is, m.

    Returns:
        ``(instants, objects, runs or 1)``.
    """
    objects, runs = truth.px.shape[1:]
    size = max(1, CHUNK // (len(POINTS) * objects * runs))
    found = np.empty((len(steps), objects, runs), dtype=bool)
    for first in range(0, len(steps), size):
        part = slice(first, first + size)
        found[part] = _occluded(truth, steps[part], origin[:, part])
    return found


def crosses(start: Array, end: Array, half_length: Array | float, half_width: Array | float) -> Mask:
    """Whether segments ``(2, ...)`` meet a box at the origin, whose sides lie along the axes.

    Source: Ericson (2005), "Real-Time Collision Detection", section 5.3.3: no axis separates the two.
    """
    mx, my = (start + end) / 2
    dx, dy = (end - start) / 2
    along, across = np.abs(dx), np.abs(dy)
    found = (np.abs(mx) <= half_length + along) & (np.abs(my) <= half_width + across)
    return np.asarray(found & (np.abs(mx * dy - my * dx) <= half_length * across + half_width * along))


def _occluded(truth: Truth, steps: Indices, origin: Array) -> Mask:
    px, py, heading = truth.px[steps], truth.py[steps], truth.heading[steps]
    c, s = np.cos(heading), np.sin(heading)
    half_length, half_width = truth.length / 2, truth.width / 2
    ahead, left = (POINTS[:, i, None, None, None] * half[:, None] for i, half in enumerate((half_length, half_width)))
    x, y = px + c * ahead - s * left, py + s * ahead + c * left
    ox, oy = (np.broadcast_to(values[None, :, None, None], x.shape) for values in origin)
    blocked = np.zeros(x.shape, dtype=bool)
    for other in range(len(truth.ids)):
        cx, cy, co, so = (values[:, other, None] for values in (px, py, c, s))
        start, end = (
            np.stack([co * (a - cx) + so * (b - cy), co * (b - cy) - so * (a - cx)]) for a, b in ((ox, oy), (x, y))
        )
        crossed = crosses(start, end, half_length[other], half_width[other])
        crossed &= truth.alive[steps, other][:, None, None]
        crossed[:, :, other] = False
        blocked |= crossed
    return np.asarray(blocked.all(axis=0))
