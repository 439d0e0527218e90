"""What sensors see."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, FieldOfView, Indices, Mask, Observer, Truth
from trackbench.engine.arithmetic import by_arithmetic
from trackbench.models.sensors import Mount, Radar, Sensor
from trackbench.models.sensors.detection import detected_share

#: Instants are multiples of a step that is not exact in binary, s.
TOLERANCE = 5e-7


def firing_steps(config: Sensor, time: Array) -> npt.NDArray[np.intp]:
    """Indices of the truth steps at which the sensor measures: the first at or after each instant of its rate.

    On a regular grid whose rate that of the sensor divides, these are the instants themselves.
    """
    assert config.rate_hz is not None
    due = np.arange(config.phase_s, time[-1] + TOLERANCE, 1.0 / config.rate_hz)
    return np.unique(np.searchsorted(time, due - TOLERANCE))


def silent(config: Sensor, time: Array) -> Mask:
    """Whether the sensor is silent at each time; a dropout holds from its first instant to before its last."""
    mask = np.zeros(np.shape(time), dtype=bool)
    for dropout in config.dropouts:
        mask |= (time >= dropout.from_s - TOLERANCE) & (time < dropout.to_s - TOLERANCE)
    return mask


class SensorMotion(NamedTuple):
    """Pose, velocity and turn rate of a sensor in the fixed frame."""

    pose: Array
    """``(3, steps)`` x m, y m, yaw rad."""
    velocity: Array
    """``(2, steps)`` m/s."""
    yaw_rate: Array
    """``(steps,)`` rad/s."""


def sensor_motion(observer: Observer, mount: Mount) -> SensorMotion:
    """The motion of a sensor fixed to the observer: its velocity includes that of the observer's rotation."""
    c, s = np.cos(observer.yaw), np.sin(observer.yaw)
    arm_x, arm_y = c * mount.x_m - s * mount.y_m, s * mount.x_m + c * mount.y_m
    yaw = observer.yaw + np.deg2rad(mount.yaw_deg)
    pose = np.stack([observer.px + arm_x, observer.py + arm_y, yaw])
    turn = observer.yaw_rate
    return SensorMotion(pose, np.stack([observer.vx - turn * arm_y, observer.vy + turn * arm_x]), turn)


#: Pairs of a line of sight and a box that are held at a time.
CHUNK = 200_000
#: Points of a box that are looked at, in half lengths and half widths: its centre and its corners.
POINTS = np.array([(0, 0), (1, 1), (1, -1), (-1, -1), (-1, 1)], dtype=float)
#: How much farther from a line of sight boxes are tested, for rounding, m.
SLACK_M = 1e-6


def occluded(truth: Truth, steps: Indices, origin: Array, asked: Mask | bool = True) -> Mask:
    """Whether other objects hide an object: their boxes cross the lines of sight to its centre and its corners.

    Args:
        truth: the motion, and the sizes.
        steps: ``(instants,)`` of the truth.
        origin: ``(2, instants)`` x, y where the sensor is, m.
        asked: ``(instants, objects, runs or 1)`` where the answer is wanted; False elsewhere.

    Returns:
        ``(instants, objects, runs or 1)``.
    """
    objects, runs = truth.px.shape[1:]
    others = objects if truth.hiders is None else objects + len(truth.hiders.ids)
    size = max(1, CHUNK // max(1, objects * runs * others))
    result = np.array(np.broadcast_to(asked, (len(steps), objects, runs)))
    for first in range(0, len(steps), size):
        part = slice(first, first + size)
        where = result[part].nonzero()
        result[part][where] = _occluded(truth, steps[part], origin[:, part], where)
    return result


def crosses(start: Array, end: Array, half_length: Array | float, half_width: Array | float) -> Mask:
    """Whether segments ``(2, ...)`` meet a box at the origin, whose sides lie along the axes.

    Source: Ericson (2005), "Real-Time Collision Detection", section 5.3.3: no axis separates the two.
    """
    mx, my = (start + end) / 2
    dx, dy = (end - start) / 2
    along, across = np.abs(dx), np.abs(dy)
    result = (np.abs(mx) <= half_length + along) & (np.abs(my) <= half_width + across)
    return np.asarray(result & (np.abs(mx * dy - my * dx) <= half_length * across + half_width * along))


def _occluded(truth: Truth, steps: Indices, origin: Array, where: tuple[Indices, ...]) -> Mask:
    """``(M,)`` whether objects are hidden; ``where``: instant, number and run of each."""
    instant, item, run = where
    px, py, c, s = (values[where] for values in _placed(truth, steps))
    ox, oy = origin[:, instant]
    half_length, half_width = truth.length[item] / 2, truth.width[item] / 2
    ahead, left = (POINTS[:, i, None] * half for i, half in enumerate((half_length, half_width)))
    x, y = px + c * ahead - s * left, py + s * ahead + c * left
    dx, dy = (px - ox)[:, None], (py - oy)[:, None]
    distance, radius = np.hypot(dx, dy), np.hypot(half_length, half_width)[:, None] + SLACK_M
    blocked = np.zeros(x.shape, dtype=bool)
    for others in (truth, truth.hiders):
        if others is None:
            continue
        placed = [np.broadcast_to(values, (*values.shape[:2], truth.px.shape[2])) for values in _placed(others, steps)]
        # Circles around the boxes tell which of them may cross a line of sight.
        rx, ry = ((values - own[:, None, None])[instant, :, run] for values, own in zip(placed, origin, strict=False))
        reach, along = (radius + np.hypot(others.length, others.width) / 2) * distance, dx * rx + dy * ry
        near = (np.abs(dx * ry - dy * rx) <= reach) & (-reach <= along) & (along <= reach + distance * distance)
        near &= others.alive[steps][instant]
        if others is truth:
            near[np.arange(len(item)), item] = False
        line, other = near.nonzero()
        if not len(line):
            continue
        cx, cy, co, so = (values[instant[line], other, run[line]] for values in placed)
        start, end = (
            np.stack([co * (a - cx) + so * (b - cy), co * (b - cy) - so * (a - cx)])
            for a, b in ((ox[None, line], oy[None, line]), (x[:, line], y[:, line]))
        )
        crossed = crosses(start, end, others.length[other] / 2, others.width[other] / 2)
        begins = np.flatnonzero(np.diff(line, prepend=-1))
        blocked[:, line[begins]] |= np.logical_or.reduceat(crossed, begins, axis=1)
    return np.asarray(blocked.all(axis=0))


def _placed(truth: Truth, steps: Indices) -> tuple[Array, Array, Array, Array]:
    """``(instants, objects, runs or 1)`` x, y, and cosine and sine of the heading."""
    heading = truth.heading[steps]
    return truth.px[steps], truth.py[steps], np.cos(heading), np.sin(heading)


#: How much farther than any sensor's range an object may hide others, m.
MARGIN_M = 10.0


def field_of_view(config: Sensor) -> FieldOfView:
    """Where a sensor can detect anything."""
    half_angle = float(np.deg2rad(config.fov_deg) / 2)
    if config.max_range_m is None:
        return FieldOfView(half_angle, np.inf)
    return FieldOfView(half_angle, config.max_range_m, config.volume() if config.has_volume() else None)


def sensor_reach(sensors: Iterable[Sensor]) -> float:
    """Distance from the observer's centre beyond which an object is neither detected nor hides another, m; no end
    without sensors."""
    limits = (
        field_of_view(sensor).max_range + float(np.hypot(sensor.mount.x_m, sensor.mount.y_m)) for sensor in sensors
    )
    return max(limits, default=np.inf) + MARGIN_M


def polar(truth: Truth, steps: Indices, motion: SensorMotion) -> Array:
    """``(3, instants, objects, runs or 1)`` range m, azimuth rad and range rate m/s from a sensor.

    Args:
        truth: the motion.
        steps: ``(instants,)`` of the truth.
        motion: the sensor's, at these instants.
    """
    target = by_arithmetic(np.stack([truth.px, truth.py, truth.vx, truth.vy])[:, steps])
    return Radar.measure(target, motion.pose[:, :, None, None], motion.velocity[:, :, None, None])


def objects_in_view(truth: Truth, steps: Indices, config: Sensor, motion: SensorMotion, seen: Array) -> Mask:
    """``(instants, objects, runs or 1)``: present, in the field of view, and not occluded; ``seen`` from ``polar``."""
    result = truth.alive[steps][:, :, None] & config.reaches(seen[0], seen[1])
    if config.occlusion:
        result &= ~occluded(truth, steps, motion.pose[:2], result)
    return np.asarray(result)


def detection_probability(config: Sensor, seen: Array) -> Array:
    """``(instants, objects, runs or 1)`` probability that an object in view is detected; ``seen`` from ``polar``."""
    distance = seen[0]
    probability: Array = np.broadcast_to(config.detection_probability, distance.shape)
    if config.detection.half_range_m is not None:
        probability = probability * detected_share(distance, config.detection.half_range_m)
    return probability


def motion_at(truth: Truth, config: Sensor, steps: Indices) -> SensorMotion:
    """The motion of a sensor at some steps of the truth."""
    return SensorMotion(*(part[..., steps] for part in sensor_motion(truth.observer, config.mount)))


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
