"""Decision which objects a tracker has to report, and at which instants."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import ABSENT, DUE, OPTIONAL, Array, Indices, Mask, Truth
from trackbench.sensing.scans import IdealSensor
from trackbench.sensing.view import motion_at, objects_in_view, polar, silent, to_rim


class Due(NamedTuple):
    """Whether each object must, may or cannot be reported at the instants at which any sensor measures."""

    steps: Indices
    """``(instants,)`` indices of the truth's steps at which any sensor measures."""
    status: npt.NDArray[np.int8]
    """``(instants, objects, runs or 1)``: ``DUE`` (must be reported), ``OPTIONAL`` (may be) or ``ABSENT``."""


def find_due(truth: Truth, sensors: Sequence[IdealSensor]) -> Due:
    """Return which objects a tracker must report (due), may report (optional) or cannot report (absent).

    A target is due where a sensor that is not silent has it in range and in its field of view, not at the rim. With
    the option ``occlusion`` the sensor must also have a line of sight to it. An object is at the rim where the edge of
    the field of view is nearer than half the diagonal of its box. Nothing is due where the truth does not count. Every
    other object present is optional. Without sensors every target that counts is due.
    """
    sensor_steps = [sensor.steps for sensor in sensors] or [np.arange(len(truth.time))]
    steps = np.unique(np.concatenate(sensor_steps))
    is_seen = np.full((len(steps), *truth.px.shape[1:]), not sensors)
    half_diagonal = np.hypot(truth.length / 2, truth.width / 2)[:, None]
    for sensor in sensors:
        config, motion = sensor.config, motion_at(truth, sensor.config, steps)
        target = polar(truth, steps, motion)
        is_known = not sensor.recorded and np.array_equal(sensor.steps, steps)
        in_view = sensor.in_view if is_known else objects_in_view(truth, steps, config, motion, target)
        is_well_inside = in_view & (to_rim(config, target) >= half_diagonal)
        is_seen |= is_well_inside & ~silent(config, truth.time[steps])[:, None, None]
    is_present = truth.alive[steps][:, :, None]
    is_due = is_present & is_seen & truth.target[:, None]
    if truth.beside is not None:
        is_due &= ~truth.beside[steps][:, :, None]
    is_due &= ~unscored(truth, steps, truth.px[steps, :, 0], truth.py[steps, :, 0])[:, :, None]
    return Due(steps, np.where(is_due, DUE, np.where(is_present, OPTIONAL, ABSENT)).astype(np.int8))


def unscored(truth: Truth, steps: Indices, x: Array, y: Array, margin: float = 0.0) -> Mask:
    """Return which points are not scored: out of range or on a don't-care box, ``(instants, points)``.

    Args:
        truth: ground truth with its scored range and don't-care boxes.
        steps: ``(instants,)`` indices of the truth's steps.
        x: ``(instants, points)`` position along x in the fixed frame, m; NaN where there is no point.
        y: ``(instants, points)`` position along y, m.
        margin: distance from a box up to which a point counts as on it, m.
    """
    is_unscored = np.zeros(x.shape, dtype=bool)
    if truth.unscored is None:
        return is_unscored
    limit, boxes, _ = truth.unscored
    is_unscored |= np.hypot(x - truth.observer.px[steps, None], y - truth.observer.py[steps, None]) > limit
    for k, time in enumerate(truth.time[steps].tolist()):
        _, _, cx, cy, heading, half_length, half_width = boxes[:, (boxes[0] <= time) & (time <= boxes[1])]
        dx, dy, c, s = x[k] - cx[:, None], y[k] - cy[:, None], np.cos(heading)[:, None], np.sin(heading)[:, None]
        along = np.maximum(np.abs(c * dx + s * dy) - half_length[:, None], 0.0)
        across = np.maximum(np.abs(c * dy - s * dx) - half_width[:, None], 0.0)
        is_unscored[k] |= (np.hypot(along, across) <= margin).any(axis=0)
    return is_unscored
