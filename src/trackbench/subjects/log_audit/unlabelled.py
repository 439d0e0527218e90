"""Detections that nobody labelled: the reference box that is nearest to each, and what is near none."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Array
from trackbench.metrics.blocks import BlockInterval, blocks_of
from trackbench.models.sensors import Sensor
from trackbench.sensing.detections import stated_detection
from trackbench.subjects.log_audit.noise import Band
from trackbench.subjects.log_audit.reference import reference_noise
from trackbench.subjects.log_audit.sensor_log import SensorLog
from trackbench.truth.config.columns import CARTESIAN, POLAR
from trackbench.truth.recorded.drive import Drive, Log, RowOrder
from trackbench.truth.sources import RecordingTruth

#: A detection further from the centre of every box is of none, m: the cutoff of GOSPA unless a scenario states another.
GATE_M = 5.0
#: Edges of the bands of the range in which detections near no box are counted, m.
EDGES = (0.0, 25.0, 50.0, 100.0, 200.0, np.inf)


@dataclass(frozen=True)
class Unlabelled:
    """What there is to say of a sensor's detections beside those near boxes."""

    scans: int
    per_scan: BlockInterval
    """Detections of a scan."""
    near: BlockInterval
    """Share of the detections that are the nearest within the gate to a box, which has one at most."""
    others: BlockInterval
    """Detections of a scan that are near no box: false alarms, and objects without one."""
    stated_others: float
    """False alarms of a scan that the sensor states."""
    bands: tuple[Band, ...]
    """The others of a scan by range; the count is theirs."""


def with_boxes(name: str, config: Sensor, drive: Drive, truth: RecordingTruth) -> Log:
    """The detections of a sensor's scans that are nearest to boxes as measurements of these objects.

    Pairs are made within a scan, the nearest first; all other detections are of no object.

    Raises:
        InputError: the sensor measures no position, or no detection is near a box.
    """
    key, scans, objects = f"truth.readings.{name}.object", drive.detections[name], len(drive.motions)
    if config.components[:2] not in (POLAR, CARTESIAN):
        raise InputError("missing: it measures no position, by which the nearest box is found", key=key)
    kept = np.isin(scans.time, drive.framed(scans.time))
    rows = kept[scans.scan]
    time, scan, measurement = scans.time[kept], (np.cumsum(kept) - 1)[scans.scan[rows]], scans.measurement[:, rows]
    every = np.repeat(time, objects), np.tile(np.arange(objects), len(time))
    log = Log(*every, np.zeros((len(measurement), len(every[0]))), time, RowOrder(len(scan), 0, 0.0, 0))
    sensor = SensorLog(name, config, log, drive, truth, reference_noise(drive), np.ones(len(measurement)))
    boxes, places = (_position(config, values) for values in (sensor.expected({}), measurement))
    boxes, owner = boxes.reshape(2, -1, objects), np.full(len(scan), -1)
    for number in np.unique(scan).tolist():
        own = np.flatnonzero(scan == number)
        away = np.hypot(*(places[:, own, None] - boxes[:, number][:, None]))
        away[~(away <= GATE_M)] = np.inf
        while np.isfinite(away).any():
            row, item = np.unravel_index(int(np.argmin(away)), away.shape)
            owner[own[row]] = item
            away[row], away[:, item] = np.inf, np.inf
    near = owner >= 0
    if not near.any():
        raise InputError(f"no detection is within {GATE_M:g} m of a box: check times, frames and units", key=key)
    at, alarms = time[scan], (time[scan[~near]], measurement[:, ~near])
    return Log(at[near], owner[near], measurement[:, near], time, log.order, *alarms)


def unlabelled_detections(sensor: SensorLog) -> Unlabelled:
    """The detections of a sensor whose boxes were found, with 95 % intervals over blocks of time."""
    log, config = sensor.log, sensor.config
    near, others, ones = _counts(log.scans, log.time), _counts(log.scans, log.alarm_time), np.ones(len(log.scans))
    distance = np.hypot(*_position(config, log.alarm_measurement))
    bands = []
    for low, high in pairwise(EDGES):
        own = (distance >= low) & (distance < high)
        if own.any():
            rate = _ratio(log.scans, _counts(log.scans, log.alarm_time[own]), ones)
            bands.append(Band(low, min(high, float(distance.max())), int(own.sum()), rate))
    _, density = stated_detection(config)
    return Unlabelled(
        scans=len(log.scans),
        per_scan=_ratio(log.scans, near + others, ones),
        near=_ratio(log.scans, near, near + others),
        others=_ratio(log.scans, others, ones),
        stated_others=density * config.volume() if density else 0.0,
        bands=tuple(bands),
    )


def _position(config: Sensor, measurement: Array) -> Array:
    """``(2, n)`` in the sensor's frame, m."""
    first, second = measurement[:2]
    polar = config.components[:2] == POLAR
    return np.stack([first * np.cos(second), first * np.sin(second)] if polar else [first, second])


def _counts(scans: Array, time: Array) -> Array:
    """``(scans,)`` how many of the times are those of each."""
    return np.bincount(np.searchsorted(scans, time), minlength=len(scans)).astype(float)


def _ratio(time: Array, total: Array, count: Array) -> BlockInterval:
    """The ratio of two sums over scans."""
    value = total.sum() / count.sum()
    blocks = blocks_of(time, np.zeros(len(time), dtype=np.intp), (total - value * count)[None])
    return blocks.intervals(np.stack([total, count]), lambda sums: sums[:1] / sums[1:])[0]
