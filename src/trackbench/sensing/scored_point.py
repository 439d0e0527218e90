"""Point of a body at which position and velocity are scored."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Truth

ScoredPoint = Literal["centre", "rear", "nearest_face"]


def truth_of_point(truth: Truth, point: ScoredPoint) -> Truth:
    """Return the ground truth of a point of each body instead of its centre.

    The body is rigid: its point moves with the centre's velocity plus the yaw rate times the offset turned left by 90°.

    Args:
        truth: ground truth of the centres.
        point: the centre, the middle of the rear, or the middle of the face nearest to the observer.

    Raises:
        InputError: the size of a body is not known.
    """
    if point == "centre":
        return truth
    for name, length, width in zip(truth.ids, truth.length, truth.width, strict=True):
        if not (length > 0 and width > 0):
            raise InputError(f"the size of {name} is not known: only its centre can be scored", key="score.point")
    half_length, half_width = truth.length[:, None] / 2, truth.width[:, None] / 2
    c, s = np.cos(truth.heading), np.sin(truth.heading)
    ahead, left = -half_length, np.zeros_like(half_width)
    if point == "nearest_face":
        dx = truth.observer.px[:, None, None] - truth.px
        dy = truth.observer.py[:, None, None] - truth.py
        x, y = c * dx + s * dy, c * dy - s * dx
        to_end, to_side = np.hypot(np.abs(x) - half_length, y), np.hypot(x, np.abs(y) - half_width)
        ahead = np.where(to_end <= to_side, np.copysign(half_length, x), 0.0)
        left = np.where(to_end <= to_side, 0.0, np.copysign(half_width, y))
    east, north = c * ahead - s * left, s * ahead + c * left
    vx, vy = truth.vx - truth.yaw_rate * north, truth.vy + truth.yaw_rate * east
    speed, course = np.hypot(vx, vy), np.arctan2(vy, vx)
    return replace(truth, px=truth.px + east, py=truth.py + north, speed=speed, course=course)
