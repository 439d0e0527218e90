"""Detections without identities: which are detected, resolution, false alarms, and what a scan states of them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.streams import stream
from trackbench.base.types import FALSE_ALARM, UNKNOWN_ORIGIN, Array, Indices, Mask, Scan
from trackbench.base.units import difference, wrap_angle
from trackbench.engine.arithmetic import by_arithmetic
from trackbench.models.sensors import Radar, Sensor
from trackbench.models.sensors.detection import ClutterPlace
from trackbench.models.sensors.effects import Sensed, answers
from trackbench.sensing.scans import (
    IdealSensor,
    Measurements,
    arrivals,
    as_given,
    effect_streams,
    make_read_only,
    noisy_measurements,
    scan_at,
    sensor_measurements,
)
from trackbench.sensing.view import field_of_view, silent


class Resolved(NamedTuple):
    """Detections of one sensor in one run, after those that it cannot tell apart have become one."""

    measurement: Array
    """``(m, instants, objects)``."""
    detected: Mask
    """``(instants, objects)``: False for an object whose detection went into that of another."""
    second: Indices
    """``(instants, objects)``: the object with the second largest share of a merged detection, else -1."""


def merge_unresolved(sensor: IdealSensor, measurement: Array, detected: Mask, run: int) -> Resolved:
    """Merge the detections of objects that are in one cell of range, azimuth and range rate.

    Two objects are, where they differ by less than the cell in each of them; a chain of such pairs is one group. A
    group gives one measurement, at the mean of its members weighted by their received power (proportional to
    ``range^-4``, all of one cross-section), with the noise of the strongest.

    Source: Daum and Fitzgerald (1994), "The importance of resolution in multiple-target tracking"; Koch and van Keuk
    (1997), "Multiple hypothesis track maintenance with possibly unresolved measurements", for the limit on differences.

    Args:
        sensor: what it would read without noise.
        measurement: ``(m, instants, objects)`` with noise.
        detected: ``(instants, objects)``.
        run: the number of the run.
    """
    assert sensor.polar is not None
    of_run = run if sensor.polar.shape[-1] > 1 else 0
    seen, ideal = sensor.polar[..., of_run], sensor.measurement[..., of_run]
    second = np.full(detected.shape, -1)
    linked = _linked(sensor, seen, detected)
    rows = np.flatnonzero(linked.any(axis=(1, 2)))
    if not len(rows):
        return Resolved(measurement, detected, second)
    group = _groups(linked[rows])
    power = np.where(detected[rows], seen[0][rows] ** -4.0, 0.0)
    together = (group[:, :, None] == group[:, None, :]) & detected[rows][:, None, :]
    shares = np.where(together, power[:, None, :], 0.0)
    strongest = np.argmax(shares, axis=-1)
    leads = detected[rows] & (strongest == np.arange(detected.shape[1]))
    shares = shares / np.maximum(shares.sum(axis=-1, keepdims=True), np.finfo(float).tiny)
    between = difference(ideal[:, rows][:, :, None, :], ideal[:, rows][:, :, :, None], sensor.config.angular)
    offset = np.einsum("kij,mkij->mki", shares, between)
    merged, result = measurement.copy(), detected.copy()
    merged[:, rows] = difference(measurement[:, rows], -offset, sensor.config.angular)
    result[rows] = leads
    others = np.where(np.eye(detected.shape[1], dtype=bool), 0.0, shares)
    partner = np.where(others.max(axis=-1) > 0.0, np.argmax(others, axis=-1), -1)
    second[rows] = np.where(leads, partner, -1)
    return Resolved(np.where(result, merged, np.nan), result, second)


def _linked(sensor: IdealSensor, seen: Array, detected: Mask) -> Mask:
    cell = sensor.config.resolution
    assert cell is not None
    linked = detected[:, :, None] & detected[:, None, :] & ~np.eye(detected.shape[1], dtype=bool)
    if cell.range_m is not None:
        linked &= np.abs(seen[0][:, :, None] - seen[0][:, None, :]) < cell.range_m
    if cell.azimuth_deg is not None:
        apart = wrap_angle(seen[1][:, :, None] - seen[1][:, None, :])
        linked &= np.abs(apart) < np.deg2rad(cell.azimuth_deg)
    if cell.range_rate_mps is not None:
        linked &= np.abs(seen[2][:, :, None] - seen[2][:, None, :]) < cell.range_rate_mps
    return linked


def _groups(linked: Mask) -> Indices:
    """``(instants, objects)`` the least number of the objects that each is linked with, directly or through others."""
    count = linked.shape[1]
    reached = linked | np.eye(count, dtype=bool)
    group = np.broadcast_to(np.arange(count), linked.shape[:2])
    while True:
        lower = np.where(reached, group[:, None, :], count).min(axis=-1)
        if np.array_equal(lower, group):
            return np.asarray(lower)
        group = lower


class FalseAlarms(NamedTuple):
    """Those of one sensor in one run."""

    instant: Indices
    """``(n,)`` number of the sensor's instant."""
    measurement: Array
    """``(m, n)``."""
    key: Array
    """``(n,)`` what they are sorted by among the detections of a scan."""


def draw_false_alarms(
    sensor: IdealSensor, seed: int, scenario: str, runs: range, sensed: Sensed | None
) -> list[list[FalseAlarms]]:
    """Of each run those of clutter and those of effects, each drawn from a stream of its own."""
    result = [_of_clutter(sensor, seed, scenario, run) for run in runs]
    if sensed is not None:
        for place, effect in enumerate(sensor.config.effects):
            alarms = answers.alarms(effect, sensed, effect_streams(sensor, place, seed, scenario, runs))
            if alarms is None:
                continue
            number, instant, ideal = alarms
            for i, run in enumerate(runs):
                random = stream(seed, scenario, run, f"false alarms of effect {place} of {sensor.name}")
                result[i].append(_noisy(sensor, instant[number == i], ideal[:, number == i], random))
    heard = ~silent(sensor.config, sensor.time)
    return [[_where(alarms, heard[alarms.instant]) for alarms in of_run] for of_run in result]


def _noisy(sensor: IdealSensor, instant: Indices, ideal: Array, random: np.random.Generator) -> FalseAlarms:
    measurement = noisy_measurements(sensor.config, ideal, random.standard_normal(ideal.shape))
    return FalseAlarms(instant, measurement, random.random(len(instant)))


def _of_clutter(sensor: IdealSensor, seed: int, scenario: str, run: int) -> list[FalseAlarms]:
    name, clutter = sensor.name, sensor.config.clutter
    result = []
    if clutter.per_scan:
        random = stream(seed, scenario, run, f"clutter of {name}")
        instant = _instants(sensor, clutter.per_scan, random)
        shares = random.random((len(sensor.noise_covariance), len(instant)))
        measurement = as_given(sensor.config, sensor.config.uniform(shares))
        result.append(FalseAlarms(instant, measurement, random.random(len(instant))))
    for i, place in enumerate(clutter.places, 1):
        result.append(_at_place(sensor, place, stream(seed, scenario, run, f"clutter of {name} at place {i}")))
    if sensor.alarms is not None:
        random = stream(seed, scenario, run, f"order of the false alarms of {name}")
        result.append(FalseAlarms(*sensor.alarms, random.random(len(sensor.alarms.scan))))
    return result


def _where(alarms: FalseAlarms, kept: Mask) -> FalseAlarms:
    return FalseAlarms(alarms.instant[kept], alarms.measurement[:, kept], alarms.key[kept])


def _instants(sensor: IdealSensor, per_scan: float, random: np.random.Generator) -> Indices:
    return np.repeat(np.arange(len(sensor.time)), random.poisson(per_scan, len(sensor.time)))


def _at_place(sensor: IdealSensor, place: ClutterPlace, random: np.random.Generator) -> FalseAlarms:
    instant = _instants(sensor, place.per_scan, random)
    count, pose, velocity = len(instant), sensor.pose[:, instant], sensor.velocity[:, instant]
    # Points at random shares of the line's length.
    corners, share = np.array(place.line), random.random(count)
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    on_line = np.stack([np.interp(share * length[-1], length, along) for along in corners.T])
    x, y = on_line + place.spread_m * random.standard_normal((2, count))
    if place.frame == "observer":
        mount = sensor.config.mount
        yaw = pose[2] - np.deg2rad(mount.yaw_deg)
        ahead, left = x - mount.x_m, y - mount.y_m
        x = pose[0] + np.cos(yaw) * ahead - np.sin(yaw) * left
        y = pose[1] + np.sin(yaw) * ahead + np.cos(yaw) * left
    still = np.zeros(count)
    target = by_arithmetic(np.stack([x, y, still, still]))
    ideal = np.asarray(sensor.config.measure(target, pose, velocity))
    alarms = _noisy(sensor, instant, ideal, random)
    distance, azimuth, _ = Radar.measure(target, pose, velocity)
    return _where(alarms, sensor.config.reaches(distance, azimuth))


#: Object number of a column without a detection.
PADDING = -2


def scenes_side_by_side(parts: Sequence[Measurements]) -> Measurements:
    """The measurements of runs of several scenes as those of one block, each run with the pose of its own sensor.

    Those of a single scene too: to the last bit a run is then the same with and without others.

    Args:
        parts: of each scene, by the same sensors at the same times.
    """
    runs = [len(part.digests) for part in parts]
    firsts = np.cumsum(runs) - runs
    scans, origins, merged = [], [], []
    for number, scan in enumerate(parts[0].scans):
        own = [part.scans[number] for part in parts]
        most = max(len(each.valid) for each in own)

        def padded(values: Sequence[Any], fill: float, most: int = most) -> Any:
            result = np.full((*values[0].shape[:-2], most, sum(runs)), fill, dtype=values[0].dtype)
            for each, first, count in zip(values, firsts, runs, strict=True):
                result[..., : each.shape[-2], first : first + count] = each
            return result

        pose, velocity = (
            np.repeat(np.stack(values, axis=-1), runs, axis=-1)
            for values in zip(*((each.sensor_pose, each.sensor_velocity) for each in own), strict=True)
        )
        measurement, valid = padded([each.measurement for each in own], np.nan), padded([each.valid for each in own], 0)
        scans.append(scan._replace(measurement=measurement, valid=valid, sensor_pose=pose, sensor_velocity=velocity))
        origins.append(padded([part.origins[number] for part in parts], PADDING))
        merged.append(padded([part.merged[number] for part in parts], -1))
    return Measurements(scans, [digest for part in parts for digest in part.digests], origins, merged)


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


def sense_hidden(sensors: Sequence[IdealSensor], seed: int, scenario: str, runs: range) -> Measurements:
    """The detections of some of the runs, each run's the same whatever the others are.

    The noise of objects is drawn as with known identities; clutter and order have streams of their own, so that an
    effect that is switched leaves every other draw as it was.
    """
    hashes = [hashlib.sha256() for _ in runs]
    result: list[tuple[Scan, Indices, Indices]] = []
    for place, sensor in enumerate(sensors):
        take = _detections if sensor.detections is None else _as_recorded
        drawn = list(take(sensor, seed, scenario, runs))
        for i, of_run in enumerate(drawn):
            hashes[i].update(of_run.instant.tobytes())
            hashes[i].update(of_run.measurement.tobytes())
        result += _scans(sensor, place, drawn, arrivals(sensor, seed, scenario))
    # Stable: sensors that fire together stay in the scenario's order.
    result.sort(key=lambda entry: entry[0].time)
    scans, origins, merged = (list(part) for part in zip(*result, strict=True)) if result else ([], [], [])
    return Measurements(scans, [run.digest() for run in hashes], origins, merged)


def _detections(sensor: IdealSensor, seed: int, scenario: str, runs: range) -> Iterator[_Detections]:
    for part, seen in sensor_measurements(sensor, seed, scenario, runs):
        alarms = draw_false_alarms(sensor, seed, scenario, part, seen.sensed)
        for i, run in enumerate(part):
            objects = Resolved(seen.measurement[..., i], seen.detected[..., i], np.full(seen.detected.shape[:2], -1))
            if sensor.config.resolution is not None:
                objects = merge_unresolved(sensor, *objects[:2], run)
            yield _of_run(sensor, seed, scenario, run, objects, alarms[i])


def _of_run(
    sensor: IdealSensor, seed: int, scenario: str, run: int, objects: Resolved, alarms: Sequence[FalseAlarms]
) -> _Detections:
    measurement, detected, second = objects
    keys = stream(seed, scenario, run, f"order of {sensor.name}").random(detected.shape)
    instant, number = np.nonzero(detected)
    false = sum(len(part.instant) for part in alarms)
    instant = np.concatenate([instant, *(part.instant for part in alarms)])
    order = np.lexsort((np.concatenate([keys[detected], *(part.key for part in alarms)]), instant))
    return _Detections(
        instant[order],
        np.concatenate([measurement[:, detected], *(part.measurement for part in alarms)], axis=1)[:, order],
        np.concatenate([number, np.full(false, FALSE_ALARM)])[order],
        np.concatenate([second[detected], np.full(false, -1)])[order],
    )


def _as_recorded(sensor: IdealSensor, seed: int, scenario: str, runs: range) -> Iterator[_Detections]:
    """Detections of unknown origin, in an order that says nothing."""
    recorded = sensor.detections
    assert recorded is not None
    heard = ~silent(sensor.config, sensor.time)[recorded.scan]
    for run in runs:
        keys = stream(seed, scenario, run, f"order of {sensor.name}").random(len(recorded.scan))
        order = np.lexsort((keys, recorded.scan))
        order = order[heard[order]]
        instant, own_track = recorded.scan[order], recorded.own_track[order]
        yield _Detections(
            instant,
            recorded.measurement[:, order],
            np.where(own_track >= 0, own_track, UNKNOWN_ORIGIN),
            np.full(len(order), -1),
        )


def stated_detection(config: Sensor) -> tuple[float, float]:
    """The detection probability that a sensor states, and its false alarms per scan and unit volume of measurements."""
    stated, per_scan = config.states.detection_probability, config.states.clutter_per_scan
    probability = config.detection_probability if stated is None else stated
    per_scan = config.clutter.per_scan if per_scan is None else per_scan
    return probability, per_scan / config.volume() if per_scan else 0.0


def _scans(
    sensor: IdealSensor, place: int, drawn: Sequence[_Detections], arrival: Array
) -> list[tuple[Scan, Indices, Indices]]:
    config, size = sensor.config, len(sensor.noise_covariance)
    counts = np.stack([np.bincount(of_run.instant, minlength=len(sensor.time)) for of_run in drawn], axis=-1)
    most = counts.max(axis=-1, initial=0)
    shape = (len(sensor.time), int(most.max(initial=0)), len(drawn))
    measurement = np.full((shape[0], size, *shape[1:]), np.nan)
    origins, merged = np.full(shape, PADDING), np.full(shape, -1)
    for i, of_run in enumerate(drawn):
        column = np.arange(len(of_run.instant)) - np.searchsorted(of_run.instant, of_run.instant)
        at = of_run.instant, column, i
        measurement[of_run.instant, :, column, i] = of_run.measurement.T
        origins[at], merged[at] = of_run.origin, of_run.merged
    valid = origins != PADDING
    make_read_only(measurement, valid, origins, merged, sensor.noise_covariance, sensor.pose, sensor.velocity)
    quiet, view = silent(config, sensor.time), field_of_view(config)
    probability, density = stated_detection(config)
    result = []
    for k in range(len(sensor.time)):
        here = slice(int(most[k]))
        scan = scan_at(sensor, k, place, arrival[k], measurement[k][:, here], valid[k, here])._replace(
            # A silent sensor says so: that it detects nothing tells nothing of the objects.
            detection_probability=0.0 if quiet[k] else probability,
            clutter_density=0.0 if quiet[k] else density,
            field_of_view=view,
            half_range_m=config.states.half_range_m,
        )
        result.append((scan, origins[k, here], merged[k, here]))
    return result
