"""Which objects a sensor has in view, and how likely it detects them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from trackbench.base.types import Array, FieldOfView, Indices, Mask, Truth
from trackbench.base.units import wrap_angle
from trackbench.models.sensors import Radar, Sensor
from trackbench.sensing.geometry import SensorMotion
from trackbench.sensing.occlusion import occluded

#: Probability of a false alarm in a cell of the radar, to which ``half_range_m`` refers.
FALSE_ALARM_PROBABILITY = 1e-6
#: How much farther than any sensor's range an object may hide others, m.
MARGIN_M = 10.0


def field_of_view(config: Sensor) -> FieldOfView:
    """Where a sensor can detect anything."""
    half_angle = float(np.deg2rad(config.fov_deg) / 2)
    if config.max_range_m is None:
        return FieldOfView(half_angle, np.inf)
    return FieldOfView(half_angle, config.max_range_m, config.volume() if config.has_volume() else None)


def reach(sensors: Iterable[Sensor]) -> float:
    """Distance from the observer's centre beyond which an object is neither detected nor hides another, m."""
    limits = (
        field_of_view(sensor).max_range + float(np.hypot(sensor.mount.x_m, sensor.mount.y_m)) for sensor in sensors
    )
    return max(limits) + MARGIN_M


def polar(truth: Truth, steps: Indices, motion: SensorMotion) -> Array:
    """``(3, instants, objects, runs or 1)`` range m, azimuth rad and range rate m/s from a sensor.

    Args:
        truth: the motion.
        steps: ``(instants,)`` of the truth.
        motion: the sensor's, at these instants.
    """
    target = np.stack([truth.px, truth.py, truth.vx, truth.vy])[:, steps]
    return Radar.measure(target, motion.pose[:, :, None, None], motion.velocity[:, :, None, None])


def in_view(truth: Truth, steps: Indices, config: Sensor, motion: SensorMotion, seen: Array) -> Mask:
    """``(instants, objects, runs or 1)``: present, in the field of view, and not occluded; ``seen`` from ``polar``."""
    field = field_of_view(config)
    inside = (np.abs(seen[1]) <= field.half_angle) & (seen[0] <= field.max_range)
    found = truth.alive[steps][:, :, None] & inside
    if config.occlusion:
        found &= ~occluded(truth, steps, motion.pose[:2])
    return np.asarray(found)


def detection_probability(truth: Truth, steps: Indices, config: Sensor, pose: Array, seen: Array) -> Array:
    """``(instants, objects, runs or 1)`` probability that an object in view is detected; ``seen`` from ``polar``.

    Source of the curve by range: Swerling (1954), "Probability of detection for fluctuating targets", case 1, where
    ``P = P_fa^(1 / (1 + S))``, with the signal-to-noise ratio S proportional to ``range^-4``.
    """
    factors, distance = config.detection, seen[0]
    probability: Array = np.broadcast_to(config.detection_probability, distance.shape)
    if factors.half_range_m is not None:
        at_half = np.log(FALSE_ALARM_PROBABILITY) / np.log(0.5) - 1.0
        signal = at_half * (factors.half_range_m / distance) ** 4
        probability = probability * FALSE_ALARM_PROBABILITY ** (1.0 / (1.0 + signal))
    if factors.by_range is not None:
        probability = probability * np.interp(distance, *np.transpose(factors.by_range))
    if factors.by_aspect is not None:
        to_sensor = seen[1] + pose[2][:, None, None] + np.pi
        aspect = np.abs(np.rad2deg(wrap_angle(to_sensor - truth.heading[steps])))
        probability = probability * np.interp(aspect, *np.transpose(factors.by_aspect))
    return probability
