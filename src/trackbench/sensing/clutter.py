"""False alarms: detections that stem from no object."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.streams import stream
from trackbench.base.types import Array, Indices, Mask
from trackbench.models.sensors import Radar
from trackbench.models.sensors.detection import ClutterPlace
from trackbench.sensing.scans import IdealSensor, with_noise
from trackbench.sensing.view import field_of_view, silent


class FalseAlarms(NamedTuple):
    """Those of one sensor in one run."""

    instant: Indices
    """``(n,)`` number of the sensor's instant."""
    measurement: Array
    """``(m, n)``."""
    key: Array
    """``(n,)`` what they are sorted by among the detections of a scan."""


def false_alarms(sensor: IdealSensor, seed: int, scenario: str, run: int) -> list[FalseAlarms]:
    """The uniform ones, and those of each place, each drawn from a stream of its own."""
    name, clutter = sensor.name, sensor.config.clutter
    found = []
    if clutter.per_scan:
        found.append(_uniform(sensor, stream(seed, scenario, run, f"clutter of {name}")))
    for i, place in enumerate(clutter.places, 1):
        found.append(_at_place(sensor, place, stream(seed, scenario, run, f"clutter of {name} at place {i}")))
    heard = ~silent(sensor.config, sensor.time)
    return [_where(alarms, heard[alarms.instant]) for alarms in found]


def _where(alarms: FalseAlarms, kept: Mask) -> FalseAlarms:
    return FalseAlarms(alarms.instant[kept], alarms.measurement[:, kept], alarms.key[kept])


def _instants(sensor: IdealSensor, per_scan: float, random: np.random.Generator) -> Indices:
    return np.repeat(np.arange(len(sensor.time)), random.poisson(per_scan, len(sensor.time)))


def _uniform(sensor: IdealSensor, random: np.random.Generator) -> FalseAlarms:
    instant = _instants(sensor, sensor.config.clutter.per_scan, random)
    measurement = sensor.config.uniform(random.random((len(sensor.noise_covariance), len(instant))))
    return FalseAlarms(instant, measurement, random.random(len(instant)))


def _at_place(sensor: IdealSensor, place: ClutterPlace, random: np.random.Generator) -> FalseAlarms:
    instant = _instants(sensor, place.per_scan, random)
    count, pose, velocity = len(instant), sensor.pose[:, instant], sensor.velocity[:, instant]
    x, y = _on_line(np.array(place.line), random.random(count)) + place.spread_m * random.standard_normal((2, count))
    if place.frame == "observer":
        mount = sensor.config.mount
        yaw = pose[2] - np.deg2rad(mount.yaw_deg)
        ahead, left = x - mount.x_m, y - mount.y_m
        x = pose[0] + np.cos(yaw) * ahead - np.sin(yaw) * left
        y = pose[1] + np.sin(yaw) * ahead + np.cos(yaw) * left
    still = np.zeros(count)
    target = np.stack([x, y, still, still])
    ideal = sensor.config.measure(target, pose, velocity)
    measurement = with_noise(sensor.config, ideal, random.standard_normal(ideal.shape))
    key = random.random(count)
    distance, azimuth, _ = Radar.measure(target, pose, velocity)
    field = field_of_view(sensor.config)
    there = (distance <= field.max_range) & (np.abs(azimuth) <= field.half_angle)
    return _where(FalseAlarms(instant, measurement, key), there)


def _on_line(corners: Array, share: Array) -> Array:
    """``(2, n)`` points of a line through ``corners`` ``(points, 2)``, at shares of its length."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    return np.stack([np.interp(share * length[-1], length, along) for along in corners.T])
