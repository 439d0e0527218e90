"""Scans that do not say which detection stems from which object, of a block of Monte-Carlo runs."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.base.streams import stream
from trackbench.base.types import FALSE_ALARM, Array, Indices, Mask, Scan
from trackbench.models.sensors import Sensor
from trackbench.sensing.clutter import false_alarms
from trackbench.sensing.resolution import resolve
from trackbench.sensing.scans import IdealSensor, arrivals, measured
from trackbench.sensing.view import field_of_view, silent

#: In place of an object's number: a column without a detection, and a recorded detection of which nobody says what
#: caused it.
PADDING, UNKNOWN = -2, -3


@dataclass(frozen=True)
class HiddenMeasurements:
    """The scans of a block of runs, in the order in which a tracker gets them, and what no tracker may know."""

    scans: list[Scan]
    """Sorted by time, then in the scenario's order of sensors; ``measurement`` ``(m, D, runs)`` and ``valid``
    ``(D, runs)``: in each run its detections first, then columns of NaN that are not valid."""
    origins: list[Indices]
    """For each scan ``(D, runs)``: the number of the object that a detection stems from (of a merged one, the one with
    the larger share), or ``FALSE_ALARM`` or ``PADDING``. Where there is no truth, the number of the sensor's own track,
    or ``UNKNOWN``."""
    merged: list[Indices]
    """For each scan ``(D, runs)``: the second object of a merged detection, else -1."""
    digests: list[bytes]
    """A fingerprint of each run's measurements."""


class _Detections(NamedTuple):
    """Those of one sensor in one run, sorted by instant."""

    instant: Indices
    """``(n,)``."""
    measurement: Array
    """``(m, n)``."""
    origin: Indices
    """``(n,)``."""
    merged: Indices
    """``(n,)``."""
    column: Indices
    """``(n,)`` within the scan."""


def sense_hidden(sensors: Sequence[IdealSensor], seed: int, scenario: str, runs: range) -> HiddenMeasurements:
    """The detections of some of the runs, each run's the same whatever the others are.

    The noise of objects is drawn as with known identities; clutter and order have streams of their own, so that an
    effect that is switched leaves every other draw as it was.
    """
    hashes = [hashlib.sha256() for _ in runs]
    found: list[tuple[Scan, Indices, Indices]] = []
    for place, sensor in enumerate(sensors):
        take = _detections if sensor.detections is None else _as_recorded
        drawn = [take(sensor, seed, scenario, run) for run in runs]
        for i, of_run in enumerate(drawn):
            hashes[i].update(of_run.instant.tobytes())
            hashes[i].update(of_run.measurement.tobytes())
        found += _scans(sensor, place, drawn, arrivals(sensor, seed, scenario))
    # Stable: sensors that fire together stay in the scenario's order.
    found.sort(key=lambda entry: entry[0].time)
    return HiddenMeasurements(
        [scan for scan, _, _ in found],
        [origins for _, origins, _ in found],
        [merged for _, _, merged in found],
        [run.digest() for run in hashes],
    )


def stated_detection_probability(config: Sensor) -> float:
    """What the sensor says of its detection probability."""
    stated = config.states.detection_probability
    return config.detection_probability if stated is None else stated


def stated_clutter_density(config: Sensor) -> float:
    """What the sensor says of the number of false alarms per scan and unit volume of the space of measurements."""
    stated = config.states.clutter_per_scan
    per_scan = config.clutter.per_scan if stated is None else stated
    return per_scan / config.volume() if per_scan else 0.0


def _detections(sensor: IdealSensor, seed: int, scenario: str, run: int) -> _Detections:
    measurement, detected = measured(sensor, seed, scenario, run)
    second = np.full(detected.shape, -1)
    if sensor.config.resolution is not None:
        measurement, detected, second = resolve(sensor, measurement, detected, run)
    keys = stream(seed, scenario, run, f"order of {sensor.name}").random(detected.shape)
    instant, number = np.nonzero(detected)
    alarms = false_alarms(sensor, seed, scenario, run)
    false = sum(len(one.instant) for one in alarms)
    instant = np.concatenate([instant, *(one.instant for one in alarms)])
    order = np.lexsort((np.concatenate([keys[detected], *(one.key for one in alarms)]), instant))
    instant = instant[order]
    return _Detections(
        instant,
        np.concatenate([measurement[:, detected], *(one.measurement for one in alarms)], axis=1)[:, order],
        np.concatenate([number, np.full(false, FALSE_ALARM)])[order],
        np.concatenate([second[detected], np.full(false, -1)])[order],
        np.arange(len(instant)) - np.searchsorted(instant, instant),
    )


def _as_recorded(sensor: IdealSensor, seed: int, scenario: str, run: int) -> _Detections:
    """Detections of unknown origin, in an order that says nothing."""
    recorded = sensor.detections
    assert recorded is not None
    keys = stream(seed, scenario, run, f"order of {sensor.name}").random(len(recorded.scan))
    order = np.lexsort((keys, recorded.scan))
    order = order[~silent(sensor.config, sensor.time)[recorded.scan[order]]]
    instant, own_track = recorded.scan[order], recorded.own_track[order]
    return _Detections(
        instant,
        recorded.measurement[:, order],
        np.where(own_track >= 0, own_track, UNKNOWN),
        np.full(len(order), -1),
        np.arange(len(instant)) - np.searchsorted(instant, instant),
    )


def _scans(
    sensor: IdealSensor, place: int, drawn: Sequence[_Detections], arrival: Array
) -> list[tuple[Scan, Indices, Indices]]:
    """Each scan with its origins and the second objects of merged detections."""
    config, size = sensor.config, len(sensor.noise_covariance)
    counts = np.stack([np.bincount(one.instant, minlength=len(sensor.time)) for one in drawn], axis=-1)
    most = counts.max(axis=-1, initial=0)
    shape = (len(sensor.time), int(most.max(initial=0)), len(drawn))
    measurement = np.full((shape[0], size, *shape[1:]), np.nan)
    origins, merged = np.full(shape, PADDING), np.full(shape, -1)
    for i, one in enumerate(drawn):
        at = one.instant, one.column, i
        measurement[at[0], :, at[1], i] = one.measurement.T
        origins[at], merged[at] = one.origin, one.merged
    valid = origins != PADDING
    _freeze(measurement, valid, origins, merged, sensor.noise_covariance, sensor.pose, sensor.velocity)
    quiet, view = silent(config, sensor.time), field_of_view(config)
    probability, density = stated_detection_probability(config), stated_clutter_density(config)
    found = []
    for k, time in enumerate(sensor.time):
        here = slice(int(most[k]))
        scan = Scan(
            time=float(time),
            sensor=sensor.name,
            kind=config.type,
            measurement=measurement[k][:, here],
            valid=valid[k, here],
            noise_covariance=sensor.noise_covariance,
            sensor_pose=sensor.pose[:, k],
            sensor_velocity=sensor.velocity[:, k],
            arrival_time=float(arrival[k]),
            # A silent sensor says so: that it detects nothing tells nothing of the objects.
            detection_probability=0.0 if quiet[k] else probability,
            clutter_density=0.0 if quiet[k] else density,
            field_of_view=view,
            place=place,
        )
        found.append((scan, origins[k, here], merged[k, here]))
    return found


def _freeze(*shared: Array | Indices | Mask) -> None:
    """One tracker must not change what the next one reads."""
    for values in shared:
        values.setflags(write=False)
