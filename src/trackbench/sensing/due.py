"""Which objects a tracker has to follow, and when."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import ABSENT, DUE, OPTIONAL, Array, Indices, Mask, Truth
from trackbench.models.sensors import Sensor
from trackbench.sensing.scans import IdealSensor
from trackbench.sensing.view import SensorMotion, field_of_view, in_view, polar, sensor_motion, silent


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
    than half the diagonal of its box. Whatever else is in the scene is optional.
    """
    steps = np.unique(np.concatenate([sensor.steps for sensor in sensors]))
    seen = np.zeros((len(steps), *truth.px.shape[1:]), dtype=bool)
    for sensor in sensors:
        seen |= well_in_view(truth, steps, sensor.config)
    alive = truth.alive[steps][:, :, None]
    due = alive & seen & truth.target[:, None]
    return Due(steps, np.where(due, DUE, np.where(alive, OPTIONAL, ABSENT)).astype(np.int8))


def well_in_view(truth: Truth, steps: Indices, config: Sensor) -> Mask:
    """``(instants, objects, runs or 1)``: one sensor has it in view and not at the rim, and is not silent."""
    motion = sensor_motion(truth.observer, config.mount)
    motion = SensorMotion(motion.pose[:, steps], motion.velocity[:, steps])
    seen = polar(truth, steps, motion)
    found = in_view(truth, steps, config, motion, seen) & (to_rim(config, seen) >= np.hypot(*_half(truth))[:, None])
    return np.asarray(found & ~silent(config, truth.time[steps])[:, None, None])


def to_rim(config: Sensor, seen: Array) -> Array:
    """Distance of objects within the field of view to its edge, m; ``seen`` from ``polar``."""
    field = field_of_view(config)
    outer = field.max_range - seen[0]
    if field.half_angle >= np.pi:
        return np.asarray(outer)
    # To a side of the sector: the perpendicular, where its foot lies on the side; else the sensor itself is nearest.
    beside = field.half_angle - np.abs(seen[1])
    side = seen[0] * np.where(beside < np.pi / 2, np.sin(beside), 1.0)
    return np.asarray(np.minimum(outer, side))


def _half(truth: Truth) -> tuple[Array, Array]:
    return truth.length / 2, truth.width / 2
