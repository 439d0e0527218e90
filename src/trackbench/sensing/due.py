"""When an object is due to be scored."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import ABSENT, DUE, OPTIONAL, Array, Indices, Mask, Truth
from trackbench.sensing.scans import IdealSensor
from trackbench.sensing.view import motion_at, objects_in_view, polar, silent, to_rim


class Due(NamedTuple):
    """At each instant at which any sensor measures."""

    steps: Indices
    """``(instants,)`` of the truth."""
    status: npt.NDArray[np.int8]
    """``(instants, objects, runs or 1)``: ``ABSENT``, ``OPTIONAL`` or ``DUE``."""


def find_due(truth: Truth, sensors: Sequence[IdealSensor]) -> Due:
    """The status of each object.

    A target is due where a sensor that is not silent has it in range and in its field of view, not at the rim, with a
    line of sight where its option ``occlusion`` is on. It is at the rim where the edge of the field of view is nearer
    than half the diagonal of its box. Where the truth says that nothing counts, no object is due. Whatever else is in
    the scene is optional. Without sensors there is nothing that has to see a target.
    """
    every = [sensor.steps for sensor in sensors] or [np.arange(len(truth.time))]
    steps = np.unique(np.concatenate(every))
    seen = np.full((len(steps), *truth.px.shape[1:]), not sensors)
    half_diagonal = np.hypot(truth.length / 2, truth.width / 2)[:, None]
    for sensor in sensors:
        config, motion = sensor.config, motion_at(truth, sensor.config, steps)
        target = polar(truth, steps, motion)
        is_known = not sensor.recorded and np.array_equal(sensor.steps, steps)
        in_view = sensor.in_view if is_known else objects_in_view(truth, steps, config, motion, target)
        well_inside = in_view & (to_rim(config, target) >= half_diagonal)
        seen |= well_inside & ~silent(config, truth.time[steps])[:, None, None]
    alive = truth.alive[steps][:, :, None]
    due = alive & seen & truth.target[:, None]
    if truth.beside is not None:
        due &= ~truth.beside[steps][:, :, None]
    due &= ~unscored(truth, steps, truth.px[steps, :, 0], truth.py[steps, :, 0])[:, :, None]
    return Due(steps, np.where(due, DUE, np.where(alive, OPTIONAL, ABSENT)).astype(np.int8))


def unscored(truth: Truth, steps: Indices, x: Array, y: Array, margin: float = 0.0) -> Mask:
    """``(instants, points)`` which points do not count: out of range or on a don't-care box.

    Args:
        truth: says where nothing counts.
        steps: ``(instants,)`` of the truth.
        x: ``(instants, points)`` m; NaN where there is none.
        y: the same.
        margin: m, up to which a point is on a box.
    """
    result = np.zeros(x.shape, dtype=bool)
    if truth.unscored is None:
        return result
    limit, boxes, _ = truth.unscored
    result |= np.hypot(x - truth.observer.px[steps, None], y - truth.observer.py[steps, None]) > limit
    for k, time in enumerate(truth.time[steps].tolist()):
        _, _, cx, cy, heading, half_length, half_width = boxes[:, (boxes[0] <= time) & (time <= boxes[1])]
        dx, dy, c, s = x[k] - cx[:, None], y[k] - cy[:, None], np.cos(heading)[:, None], np.sin(heading)[:, None]
        along = np.maximum(np.abs(c * dx + s * dy) - half_length[:, None], 0.0)
        across = np.maximum(np.abs(c * dy - s * dx) - half_width[:, None], 0.0)
        result[k] |= (np.hypot(along, across) <= margin).any(axis=0)
    return result
