"""Detections with hidden identities: merged unresolved objects, false alarms, and the scans of several runs."""

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
    """Detections of one sensor in one run, after the merging of objects that the sensor cannot tell apart."""

    measurement: Array
    """``(m, instants, objects)`` measurement of each object, or of the group merged into its detection."""
    detected: Mask
    """``(instants, objects)`` whether the object has a detection; False if it was merged into another object's."""
    second: Indices
    """``(instants, objects)`` index of the object with the second largest share of a merged detection, else -1."""


def merge_unresolved(sensor: IdealSensor, measurement: Array, detected: Mask, run: int) -> Resolved:
    """Merge the detections of objects that are in one cell of range, azimuth and range rate.

    Two objects share a cell if they differ by less than the cell's size in every component; chained pairs are a group.
    A group gives one measurement with the noise of its strongest member, at the mean of its members weighted by
    received power (proportional to ``range^-4``: all have one cross-section).

    Source: Daum and Fitzgerald (1994), "The importance of resolution in multiple-target tracking"; Koch and van Keuk
    (1997), "Multiple hypothesis track maintenance with possibly unresolved measurements", for the limit on differences.

    Args:
        sensor: measurements of the sensor without noise.
        measurement: ``(m, instants, objects)`` measurements with noise.
        detected: ``(instants, objects)`` whether the object is detected.
        run: number of the run, from 0.
    """
    assert sensor.polar is not None
    ideal_run = run if sensor.polar.shape[-1] > 1 else 0
    polar, ideal = sensor.polar[..., ideal_run], sensor.measurement[..., ideal_run]
    second = np.full(detected.shape, -1)
    is_linked = _unresolved_pairs(sensor, polar, detected)
    rows = np.flatnonzero(is_linked.any(axis=(1, 2)))
    if not len(rows):
        return Resolved(measurement, detected, second)
    group = _group_numbers(is_linked[rows])
    power = np.where(detected[rows], polar[0][rows] ** -4.0, 0.0)
    shares_group = (group[:, :, None] == group[:, None, :]) & detected[rows][:, None, :]
    shares = np.where(shares_group, power[:, None, :], 0.0)
    strongest = np.argmax(shares, axis=-1)
    is_leader = detected[rows] & (strongest == np.arange(detected.shape[1]))
    shares = shares / np.maximum(shares.sum(axis=-1, keepdims=True), np.finfo(float).tiny)
    between = difference(ideal[:, rows][:, :, None, :], ideal[:, rows][:, :, :, None], sensor.config.angular)
    offset = np.einsum("kij,mkij->mki", shares, between)
    merged, is_detected = measurement.copy(), detected.copy()
    merged[:, rows] = difference(measurement[:, rows], -offset, sensor.config.angular)
    is_detected[rows] = is_leader
    other_shares = np.where(np.eye(detected.shape[1], dtype=bool), 0.0, shares)
    partner = np.where(other_shares.max(axis=-1) > 0.0, np.argmax(other_shares, axis=-1), -1)
    second[rows] = np.where(is_leader, partner, -1)
    return Resolved(np.where(is_detected, merged, np.nan), is_detected, second)


def _unresolved_pairs(sensor: IdealSensor, polar: Array, detected: Mask) -> Mask:
    cell = sensor.config.resolution
    assert cell is not None
    is_linked = detected[:, :, None] & detected[:, None, :] & ~np.eye(detected.shape[1], dtype=bool)
    if cell.range_m is not None:
        is_linked &= np.abs(polar[0][:, :, None] - polar[0][:, None, :]) < cell.range_m
    if cell.azimuth_deg is not None:
        azimuth_difference = wrap_angle(polar[1][:, :, None] - polar[1][:, None, :])
        is_linked &= np.abs(azimuth_difference) < np.deg2rad(cell.azimuth_deg)
    if cell.range_rate_mps is not None:
        is_linked &= np.abs(polar[2][:, :, None] - polar[2][:, None, :]) < cell.range_rate_mps
    return is_linked


def _group_numbers(linked: Mask) -> Indices:
    """Return each object's group, ``(instants, objects)``: the smallest index of an object in one cell with it."""
    count = linked.shape[1]
    is_linked_or_self = linked | np.eye(count, dtype=bool)
    group = np.broadcast_to(np.arange(count), linked.shape[:2])
    while True:
        lower = np.where(is_linked_or_self, group[:, None, :], count).min(axis=-1)
        if np.array_equal(lower, group):
            return np.asarray(lower)
        group = lower


class FalseAlarms(NamedTuple):
    """False alarms of one sensor in one run."""

    instant: Indices
    """``(n,)`` index of the sensor's instant of each false alarm."""
    measurement: Array
    """``(m, n)`` measurement of each false alarm."""
    key: Array
    """``(n,)`` random number of each false alarm, by which it is sorted among the detections of a scan."""


def draw_false_alarms(
    sensor: IdealSensor, seed: int, scenario: str, runs: range, sensed: Sensed | None
) -> list[list[FalseAlarms]]:
    """Return for each run a list of false alarms: those of clutter, then of each effect, from random streams apart."""
    result = [_clutter_alarms(sensor, seed, scenario, run) for run in runs]
    if sensed is not None:
        for place, effect in enumerate(sensor.config.effects):
            alarms = answers.alarms(effect, sensed, effect_streams(sensor, place, seed, scenario, runs))
            if alarms is None:
                continue
            run_index, instant, ideal = alarms
            for i, run in enumerate(runs):
                random = stream(seed, scenario, run, f"false alarms of effect {place} of {sensor.name}")
                result[i].append(_alarms_with_noise(sensor, instant[run_index == i], ideal[:, run_index == i], random))
    is_heard = ~silent(sensor.config, sensor.time)
    return [[_select_alarms(alarms, is_heard[alarms.instant]) for alarms in run_alarms] for run_alarms in result]


def _alarms_with_noise(sensor: IdealSensor, instant: Indices, ideal: Array, random: np.random.Generator) -> FalseAlarms:
    measurement = noisy_measurements(sensor.config, ideal, random.standard_normal(ideal.shape))
    return FalseAlarms(instant, measurement, random.random(len(instant)))


def _clutter_alarms(sensor: IdealSensor, seed: int, scenario: str, run: int) -> list[FalseAlarms]:
    name, clutter = sensor.name, sensor.config.clutter
    result = []
    if clutter.per_scan:
        random = stream(seed, scenario, run, f"clutter of {name}")
        instant = _instants(sensor, clutter.per_scan, random)
        shares = random.random((len(sensor.noise_covariance), len(instant)))
        measurement = as_given(sensor.config, sensor.config.uniform(shares))
        result.append(FalseAlarms(instant, measurement, random.random(len(instant))))
    for i, place in enumerate(clutter.places, 1):
        result.append(_alarms_at_place(sensor, place, stream(seed, scenario, run, f"clutter of {name} at place {i}")))
    if sensor.alarms is not None:
        random = stream(seed, scenario, run, f"order of the false alarms of {name}")
        result.append(FalseAlarms(*sensor.alarms, random.random(len(sensor.alarms.scan))))
    return result


def _select_alarms(alarms: FalseAlarms, is_kept: Mask) -> FalseAlarms:
    return FalseAlarms(alarms.instant[is_kept], alarms.measurement[:, is_kept], alarms.key[is_kept])


def _instants(sensor: IdealSensor, per_scan: float, random: np.random.Generator) -> Indices:
    return np.repeat(np.arange(len(sensor.time)), random.poisson(per_scan, len(sensor.time)))


def _alarms_at_place(sensor: IdealSensor, place: ClutterPlace, random: np.random.Generator) -> FalseAlarms:
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
    zeros = np.zeros(count)
    target = by_arithmetic(np.stack([x, y, zeros, zeros]))
    ideal = np.asarray(sensor.config.measure(target, pose, velocity))
    alarms = _alarms_with_noise(sensor, instant, ideal, random)
    distance, azimuth, _ = Radar.measure(target, pose, velocity)
    return _select_alarms(alarms, sensor.config.reaches(distance, azimuth))


#: Object number of a column without a detection.
PADDING = -2


def scenes_side_by_side(parts: Sequence[Measurements]) -> Measurements:
    """Join the measurements of several scenes along the axis of runs, each run with its own sensor pose.

    A single scene is treated alike, so that a run has the same bits whether or not other scenes are joined.

    Args:
        parts: measurements of each scene, by the same sensors at the same times.
    """
    runs = [len(part.digests) for part in parts]
    firsts = np.cumsum(runs) - runs
    scans, origins, merged = [], [], []
    for number, scan in enumerate(parts[0].scans):
        scene_scans = [part.scans[number] for part in parts]
        column_count = max(len(each.valid) for each in scene_scans)

        def padded(values: Sequence[Any], fill: float, column_count: int = column_count) -> Any:
            result = np.full((*values[0].shape[:-2], column_count, sum(runs)), fill, dtype=values[0].dtype)
            for each, first, count in zip(values, firsts, runs, strict=True):
                result[..., : each.shape[-2], first : first + count] = each
            return result

        pose, velocity = (
            np.repeat(np.stack(values, axis=-1), runs, axis=-1)
            for values in zip(*((each.sensor_pose, each.sensor_velocity) for each in scene_scans), strict=True)
        )
        measurement = padded([each.measurement for each in scene_scans], np.nan)
        valid = padded([each.valid for each in scene_scans], 0)
        scans.append(scan._replace(measurement=measurement, valid=valid, sensor_pose=pose, sensor_velocity=velocity))
        origins.append(padded([part.origins[number] for part in parts], PADDING))
        merged.append(padded([part.merged[number] for part in parts], -1))
    return Measurements(scans, [digest for part in parts for digest in part.digests], origins, merged)


class _Detections(NamedTuple):
    """Detections of one sensor in one run, sorted by instant: ``measurement`` is ``(m, n)``, the others ``(n,)``."""

    instant: Indices
    measurement: Array
    origin: Indices
    merged: Indices


def sense_hidden(sensors: Sequence[IdealSensor], seed: int, scenario: str, runs: range) -> Measurements:
    """Return the measurements of ``runs`` with hidden identities; a run's bits do not depend on the other runs.

    The noise of objects is drawn as with known identities. Clutter and the order of detections have random streams of
    their own, so that switching an effect leaves every other draw unchanged.
    """
    hashes = [hashlib.sha256() for _ in runs]
    result: list[tuple[Scan, Indices, Indices]] = []
    for place, sensor in enumerate(sensors):
        detections_of = _synthesised_detections if sensor.detections is None else _recorded_detections
        drawn = list(detections_of(sensor, seed, scenario, runs))
        for i, detections in enumerate(drawn):
            hashes[i].update(detections.instant.tobytes())
            hashes[i].update(detections.measurement.tobytes())
        result += _scans(sensor, place, drawn, arrivals(sensor, seed, scenario))
    # Stable: sensors that fire together stay in the scenario's order.
    result.sort(key=lambda entry: entry[0].time)
    scans, origins, merged = (list(part) for part in zip(*result, strict=True)) if result else ([], [], [])
    return Measurements(scans, [run.digest() for run in hashes], origins, merged)


def _synthesised_detections(sensor: IdealSensor, seed: int, scenario: str, runs: range) -> Iterator[_Detections]:
    for part, data in sensor_measurements(sensor, seed, scenario, runs):
        alarms = draw_false_alarms(sensor, seed, scenario, part, data.sensed)
        for i, run in enumerate(part):
            objects = Resolved(data.measurement[..., i], data.detected[..., i], np.full(data.detected.shape[:2], -1))
            if sensor.config.resolution is not None:
                objects = merge_unresolved(sensor, *objects[:2], run)
            yield _sorted_detections(sensor, seed, scenario, run, objects, alarms[i])


def _sorted_detections(
    sensor: IdealSensor, seed: int, scenario: str, run: int, objects: Resolved, alarms: Sequence[FalseAlarms]
) -> _Detections:
    measurement, detected, second = objects
    keys = stream(seed, scenario, run, f"order of {sensor.name}").random(detected.shape)
    instant, number = np.nonzero(detected)
    false_alarm_count = sum(len(part.instant) for part in alarms)
    instant = np.concatenate([instant, *(part.instant for part in alarms)])
    order = np.lexsort((np.concatenate([keys[detected], *(part.key for part in alarms)]), instant))
    return _Detections(
        instant[order],
        np.concatenate([measurement[:, detected], *(part.measurement for part in alarms)], axis=1)[:, order],
        np.concatenate([number, np.full(false_alarm_count, FALSE_ALARM)])[order],
        np.concatenate([second[detected], np.full(false_alarm_count, -1)])[order],
    )


def _recorded_detections(sensor: IdealSensor, seed: int, scenario: str, runs: range) -> Iterator[_Detections]:
    recorded = sensor.detections
    assert recorded is not None
    is_heard = ~silent(sensor.config, sensor.time)[recorded.scan]
    for run in runs:
        keys = stream(seed, scenario, run, f"order of {sensor.name}").random(len(recorded.scan))
        order = np.lexsort((keys, recorded.scan))
        order = order[is_heard[order]]
        instant, own_track = recorded.scan[order], recorded.own_track[order]
        yield _Detections(
            instant,
            recorded.measurement[:, order],
            np.where(own_track >= 0, own_track, UNKNOWN_ORIGIN),
            np.full(len(order), -1),
        )


def stated_detection(config: Sensor) -> tuple[float, float]:
    """Return P_D and clutter density of a sensor as configured; the density per scan and unit of measurement volume."""
    stated, per_scan = config.states.detection_probability, config.states.clutter_per_scan
    probability = config.detection_probability if stated is None else stated
    per_scan = config.clutter.per_scan if per_scan is None else per_scan
    return probability, per_scan / config.volume() if per_scan else 0.0


def _scans(
    sensor: IdealSensor, place: int, drawn: Sequence[_Detections], arrival: Array
) -> list[tuple[Scan, Indices, Indices]]:
    config, size = sensor.config, len(sensor.noise_covariance)
    counts = np.stack([np.bincount(detections.instant, minlength=len(sensor.time)) for detections in drawn], axis=-1)
    column_counts = counts.max(axis=-1, initial=0)
    shape = (len(sensor.time), int(column_counts.max(initial=0)), len(drawn))
    measurement = np.full((shape[0], size, *shape[1:]), np.nan)
    origins, merged = np.full(shape, PADDING), np.full(shape, -1)
    for i, detections in enumerate(drawn):
        column = np.arange(len(detections.instant)) - np.searchsorted(detections.instant, detections.instant)
        at = detections.instant, column, i
        measurement[detections.instant, :, column, i] = detections.measurement.T
        origins[at], merged[at] = detections.origin, detections.merged
    valid = origins != PADDING
    make_read_only(measurement, valid, origins, merged, sensor.noise_covariance, sensor.pose, sensor.velocity)
    is_silent, view = silent(config, sensor.time), field_of_view(config)
    probability, density = stated_detection(config)
    result = []
    for k in range(len(sensor.time)):
        columns = slice(int(column_counts[k]))
        scan = scan_at(sensor, k, place, arrival[k], measurement[k][:, columns], valid[k, columns])._replace(
            # A silent sensor states a P_D of zero: its empty scans are no evidence about objects.
            detection_probability=0.0 if is_silent[k] else probability,
            clutter_density=0.0 if is_silent[k] else density,
            field_of_view=view,
            half_range_m=config.states.half_range_m,
        )
        result.append((scan, origins[k, columns], merged[k, columns]))
    return result
