"""Fields of view, occlusion and motion of sensors."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, FieldOfView, Indices, Mask, Observer, Truth
from trackbench.engine.arithmetic import by_arithmetic
from trackbench.models.sensors import Mount, Radar, Sensor
from trackbench.models.sensors.detection import detected_share

#: Tolerance of times, which are multiples of a step that is not exact in binary, s.
TOLERANCE = 5e-7


def firing_steps(config: Sensor, time: Array) -> npt.NDArray[np.intp]:
    """Return the indices of the truth steps at which the sensor measures.

    Each is the first step at or after an instant of the sensor's rate.
    """
    assert config.rate_hz is not None
    firing_times = np.arange(config.phase_s, time[-1] + TOLERANCE, 1.0 / config.rate_hz)
    return np.unique(np.searchsorted(time, firing_times - TOLERANCE))


def silent(config: Sensor, time: Array) -> Mask:
    """Return a mask ``(times,)``, True in a dropout of the sensor; a dropout includes its start but not its end."""
    is_silent = np.zeros(np.shape(time), dtype=bool)
    for dropout in config.dropouts:
        is_silent |= (time >= dropout.from_s - TOLERANCE) & (time < dropout.to_s - TOLERANCE)
    return is_silent


class SensorMotion(NamedTuple):
    """Pose, velocity and turn rate of a sensor in the fixed frame."""

    pose: Array
    """``(3, steps)`` x and y, m, and yaw, rad."""
    velocity: Array
    """``(2, steps)`` velocity along x and y, m/s."""
    yaw_rate: Array


def sensor_motion(observer: Observer, mount: Mount) -> SensorMotion:
    """Return the motion of a sensor on the observer; its velocity includes the observer's rotation."""
    c, s = np.cos(observer.yaw), np.sin(observer.yaw)
    arm_x, arm_y = c * mount.x_m - s * mount.y_m, s * mount.x_m + c * mount.y_m
    yaw = observer.yaw + np.deg2rad(mount.yaw_deg)
    pose = np.stack([observer.px + arm_x, observer.py + arm_y, yaw])
    turn = observer.yaw_rate
    return SensorMotion(pose, np.stack([observer.vx - turn * arm_y, observer.vy + turn * arm_x]), turn)


#: Pairs of a line of sight and a box tested at a time.
CHUNK = 200_000
#: Points of a box to which lines of sight go, in half lengths and half widths: its centre and its corners.
POINTS = np.array([(0, 0), (1, 1), (1, -1), (-1, -1), (-1, 1)], dtype=float)
#: Extra distance from a line of sight at which boxes are still tested, against rounding, m.
SLACK_M = 1e-6


def occluded(truth: Truth, steps: Indices, origin: Array, is_tested: Mask | bool = True) -> Mask:
    """Return which objects are hidden: boxes of other objects cross all lines of sight to centre and corners.

    Args:
        truth: motion and sizes of the objects.
        steps: ``(instants,)`` indices of the truth's steps.
        origin: ``(2, instants)`` x, y of the sensor, m.
        is_tested: ``(instants, objects, runs or 1)`` objects to test; the result is False for all others.

    Returns:
        Mask ``(instants, objects, runs or 1)``.
    """
    objects, runs = truth.px.shape[1:]
    hider_count = objects if truth.hiders is None else objects + len(truth.hiders.ids)
    size = max(1, CHUNK // max(1, objects * runs * hider_count))
    is_occluded = np.array(np.broadcast_to(is_tested, (len(steps), objects, runs)))
    for first in range(0, len(steps), size):
        part = slice(first, first + size)
        tested = is_occluded[part].nonzero()
        is_occluded[part][tested] = _occluded(truth, steps[part], origin[:, part], tested)
    return is_occluded


def crosses(start: Array, end: Array, half_length: Array | float, half_width: Array | float) -> Mask:
    """Return a mask ``(...)`` of the segments ``(2, ...)`` that meet a box centred on the origin, sides along the axes.

    Source: Ericson (2005), "Real-Time Collision Detection", section 5.3.3 (separating axes).
    """
    mx, my = (start + end) / 2
    dx, dy = (end - start) / 2
    along, across = np.abs(dx), np.abs(dy)
    result = (np.abs(mx) <= half_length + along) & (np.abs(my) <= half_width + across)
    return np.asarray(result & (np.abs(mx * dy - my * dx) <= half_length * across + half_width * along))


def _occluded(truth: Truth, steps: Indices, origin: Array, tested: tuple[Indices, ...]) -> Mask:
    """Return which of M tests find an object hidden, ``(M,)``; ``tested``: instant, object and run index of each."""
    instant, obj, run = tested
    px, py, c, s = (values[tested] for values in _placed(truth, steps))
    ox, oy = origin[:, instant]
    half_length, half_width = truth.length[obj] / 2, truth.width[obj] / 2
    ahead, left = (POINTS[:, i, None] * half for i, half in enumerate((half_length, half_width)))
    x, y = px + c * ahead - s * left, py + s * ahead + c * left
    dx, dy = (px - ox)[:, None], (py - oy)[:, None]
    distance, radius = np.hypot(dx, dy), np.hypot(half_length, half_width)[:, None] + SLACK_M
    is_blocked = np.zeros(x.shape, dtype=bool)
    for hiders in (truth, truth.hiders):
        if hiders is None:
            continue
        placed = [np.broadcast_to(values, (*values.shape[:2], truth.px.shape[2])) for values in _placed(hiders, steps)]
        # Boxes whose enclosing circle stays off a line of sight cannot cross it.
        rx, ry = ((values - o[:, None, None])[instant, :, run] for values, o in zip(placed, origin, strict=False))
        reach, along = (radius + np.hypot(hiders.length, hiders.width) / 2) * distance, dx * rx + dy * ry
        is_near = (np.abs(dx * ry - dy * rx) <= reach) & (-reach <= along) & (along <= reach + distance * distance)
        is_near &= hiders.alive[steps][instant]
        if hiders is truth:
            is_near[np.arange(len(obj)), obj] = False
        line, hider = is_near.nonzero()
        if not len(line):
            continue
        cx, cy, co, so = (values[instant[line], hider, run[line]] for values in placed)
        start, end = (
            np.stack([co * (a - cx) + so * (b - cy), co * (b - cy) - so * (a - cx)])
            for a, b in ((ox[None, line], oy[None, line]), (x[:, line], y[:, line]))
        )
        is_crossing = crosses(start, end, hiders.length[hider] / 2, hiders.width[hider] / 2)
        line_starts = np.flatnonzero(np.diff(line, prepend=-1))
        is_blocked[:, line[line_starts]] |= np.logical_or.reduceat(is_crossing, line_starts, axis=1)
    return np.asarray(is_blocked.all(axis=0))


def _placed(truth: Truth, steps: Indices) -> tuple[Array, Array, Array, Array]:
    """Return x, y, and cosine and sine of the heading of the objects, each ``(instants, objects, runs or 1)``."""
    heading = truth.heading[steps]
    return truth.px[steps], truth.py[steps], np.cos(heading), np.sin(heading)


#: Distance beyond any sensor's range at which an object may still hide others, m.
MARGIN_M = 10.0


def field_of_view(config: Sensor) -> FieldOfView:
    half_angle = float(np.deg2rad(config.fov_deg) / 2)
    if config.max_range_m is None:
        return FieldOfView(half_angle, np.inf)
    return FieldOfView(half_angle, config.max_range_m, config.volume() if config.has_volume() else None)


def sensor_reach(sensors: Iterable[Sensor]) -> float:
    """Return the distance from the observer beyond which no sensor sees an object, m; infinite without sensors."""
    limits = (
        field_of_view(sensor).max_range + float(np.hypot(sensor.mount.x_m, sensor.mount.y_m)) for sensor in sensors
    )
    return max(limits, default=np.inf) + MARGIN_M


def polar(truth: Truth, steps: Indices, motion: SensorMotion) -> Array:
    """Return range m, azimuth rad and range rate m/s from a sensor, ``(3, instants, objects, runs or 1)``.

    Args:
        truth: ground truth.
        steps: ``(instants,)`` indices of the truth's steps.
        motion: motion of the sensor at the same instants.
    """
    target = by_arithmetic(np.stack([truth.px, truth.py, truth.vx, truth.vy])[:, steps])
    return Radar.measure(target, motion.pose[:, :, None, None], motion.velocity[:, :, None, None])


def objects_in_view(truth: Truth, steps: Indices, config: Sensor, motion: SensorMotion, polar_values: Array) -> Mask:
    """Return which objects are in the field of view and not occluded, ``(instants, objects, runs or 1)``."""
    result = truth.alive[steps][:, :, None] & config.reaches(polar_values[0], polar_values[1])
    if config.occlusion:
        result &= ~occluded(truth, steps, motion.pose[:2], result)
    return np.asarray(result)


def detection_probability(config: Sensor, polar_values: Array) -> Array:
    """Return the detection probability of each object in view, ``(instants, objects, runs or 1)``."""
    distance = polar_values[0]
    probability: Array = np.broadcast_to(config.detection_probability, distance.shape)
    if config.detection.half_range_m is not None:
        probability = probability * detected_share(distance, config.detection.half_range_m)
    return probability


def motion_at(truth: Truth, config: Sensor, steps: Indices) -> SensorMotion:
    """Return the motion of a sensor at the truth's steps with the indices ``steps``."""
    return SensorMotion(*(part[..., steps] for part in sensor_motion(truth.observer, config.mount)))


def to_rim(config: Sensor, polar_values: Array) -> Array:
    """Return the distance of each object to the nearest edge of the field of view, m; for objects inside it."""
    field = field_of_view(config)
    outer = field.max_range - polar_values[0]
    if field.half_angle >= np.pi:
        return np.asarray(outer)
    # The nearest point of a side of the sector is the foot of the perpendicular, else the sensor itself.
    beside = field.half_angle - np.abs(polar_values[1])
    side = polar_values[0] * np.where(beside < np.pi / 2, np.sin(beside), 1.0)
    return np.asarray(np.minimum(outer, side))
