"""Synthesised or recorded measurements of several Monte-Carlo runs at once."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.streams import RunStreams, fast_streams, stream, streams
from trackbench.base.types import (
    Array,
    Indices,
    Mask,
    RecordedAlarms,
    RecordedDetections,
    RecordedMeasurements,
    Scan,
    Truth,
    of_runs,
)
from trackbench.base.units import difference, wrap_angle
from trackbench.engine.arithmetic import by_arithmetic
from trackbench.models.sensors import Sensor
from trackbench.models.sensors.effects import Bodies, Sensed, answers
from trackbench.sensing.view import detection_probability, firing_steps, motion_at, objects_in_view, polar, silent
from trackbench.truth.base import Recorded


@dataclass(frozen=True)
class IdealSensor:
    """Measurements of one sensor at the instants at which it measures: without noise, or as recorded."""

    name: str
    config: Sensor
    steps: Indices
    """``(instants,)`` indices of the truth's steps at which the sensor measures."""
    time: Array
    """``(instants,)`` time of each measurement, s."""
    measurement: Array
    """``(m, instants, objects, runs or 1)`` measurement of each object, before noise unless recorded."""
    visible: Mask
    """``(instants, objects, runs or 1)`` whether the object is in view and the sensor is in no dropout."""
    in_view: Mask
    """``(instants, objects, runs or 1)`` whether the object is present, in the field of view and not occluded."""
    probability: Array
    """``(instants, objects, runs or 1)`` detection probability of a visible object."""
    pose: Array
    """``(3, instants)`` x and y, m, and yaw, rad, of the sensor in the fixed frame."""
    velocity: Array
    """``(2, instants)`` velocity of the sensor in the fixed frame, m/s."""
    yaw_rate: Array
    """``(instants,)`` yaw rate of the sensor, rad/s."""
    noise_covariance: Array
    """``(m, m)`` covariance of the measurement noise."""
    polar: Array | None = None
    """``(3, instants, objects, runs or 1)`` true range m, azimuth rad and range rate m/s; None unless the sensor has a
    limited resolution."""
    cycle_starts: Indices = field(default_factory=lambda: np.arange(0))
    """``(cycles,)`` index of the first instant of each recorded measurement cycle; empty if synthesised."""
    bodies: Bodies | None = None
    """Scored points, boxes and headings of the objects at each instant, which effects need; None without effects."""
    recorded: bool = False
    """Whether ``measurement`` is from a recording: no noise is added to it, and a missed object is NaN."""
    detections: RecordedDetections | None = None
    """Recorded detections whose objects are unknown; None if there are none."""
    alarms: RecordedAlarms | None = None
    """Detections that a recording marks as false alarms; None if it marks none."""


def ideal_sensors(
    truth: Truth, sensors: Mapping[str, Sensor], recorded: Mapping[str, Recorded] | None = None
) -> list[IdealSensor]:
    """Return the measurements of each sensor before noise, which all runs share.

    Args:
        truth: ground truth.
        sensors: sensors by name.
        recorded: recorded measurements by name of the sensor; None if all are synthesised.
    """
    return [
        _recorded_sensor(truth, name, config, recorded[name])
        if recorded and name in recorded
        else ideal_sensor(truth, name, config, firing_steps(config, truth.time))
        for name, config in sensors.items()
    ]


def fingerprint_of(digest: bytes) -> str:
    """Return the hash of a run's measurements as the text written in results and exported files."""
    return digest.hex()[:16]


@dataclass(frozen=True)
class Measurements:
    """Scans of a block of runs in acquisition order, and the origins of their detections, hidden from trackers."""

    scans: list[Scan]
    """Scans sorted by time, then by the scenario's order of sensors. With known identities the batch axis is
    ``(objects * runs,)``, objects slowest. With hidden identities ``measurement`` is ``(m, D, runs)`` and ``valid``
    ``(D, runs)``; each run's detections come first, then invalid columns of NaN."""
    digests: list[bytes]
    """Hash of all measurements of each run, by which results are recognised as made from equal data."""
    origins: list[Indices] = field(default_factory=list)
    """Origin of each detection by scan, ``(D, runs)``; empty with known identities. An origin is the index of an
    object (the one with the larger share of a merged detection), ``FALSE_ALARM``, ``PADDING`` or ``UNKNOWN_ORIGIN``.
    Without ground truth it is the index of the sensor's own track, or ``UNKNOWN_ORIGIN``."""
    merged: list[Indices] = field(default_factory=list)
    """Index of the second object in each merged detection of a scan, ``(D, runs)``; -1 for a single object."""

    def detected(self) -> dict[str, int]:
        """Return, by name of the sensor, its number of detections of objects in all scans and runs."""
        counts = dict.fromkeys((scan.sensor for scan in self.scans), 0)
        are_of_objects = [origins >= 0 for origins in self.origins] or [scan.valid for scan in self.scans]
        for scan, is_of_object in zip(self.scans, are_of_objects, strict=True):
            counts[scan.sensor] += int(np.count_nonzero(is_of_object))
        return counts


def sense_known(sensors: Sequence[IdealSensor], seed: int, scenario: str, runs: range) -> Measurements:
    """Return the measurements of the runs ``runs`` with known identities; each depends only on its number and seed."""
    scans: list[Scan] = []
    hashes = [hashlib.sha256() for _ in runs]
    for place, sensor in enumerate(sensors):
        size, instants, objects = sensor.measurement.shape[:3]
        measurement = np.empty((instants, size, objects, len(runs)))
        valid = np.empty((instants, objects, len(runs)), dtype=bool)
        keys = stream(0, "", 0, "fingerprints").integers(2**64, size=2 * size * instants * objects, dtype=np.uint64)
        for part, (noisy, detected, _) in sensor_measurements(sensor, seed, scenario, runs):
            columns = slice(part.start - runs.start, part.stop - runs.start)
            measurement[..., columns], valid[..., columns] = np.swapaxes(noisy, 0, 1), detected
            for run, total in zip(hashes[columns], hashed(np.moveaxis(noisy, -1, 0), keys), strict=True):
                run.update(total)
        make_read_only(measurement, valid, sensor.noise_covariance, sensor.pose, sensor.velocity)
        scans += [
            scan_at(sensor, k, place, arrival, measurement[k].reshape(size, -1), valid[k].reshape(-1))
            for k, arrival in enumerate(arrivals(sensor, seed, scenario))
        ]
    # Stable: sensors that fire together stay in the scenario's order.
    scans.sort(key=lambda scan: scan.time)
    return Measurements(scans, [run.digest() for run in hashes])


def scan_at(sensor: IdealSensor, k: int, place: int, arrival: float, measurement: Array, valid: Mask) -> Scan:
    """Return the scan at the sensor's instant ``k``, which arrives at ``arrival`` s; ``place``: index of the sensor."""
    return Scan(
        time=float(sensor.time[k]),
        sensor=sensor.name,
        kind=sensor.config.type,
        measurement=measurement,
        valid=valid,
        noise_covariance=sensor.noise_covariance,
        sensor_pose=sensor.pose[:, k],
        sensor_velocity=sensor.velocity[:, k],
        arrival_time=float(arrival),
        place=place,
    )


def make_read_only(*shared: Array | Indices | Mask) -> None:
    """Make the arrays read-only, so that no tracker changes the measurements that other trackers read."""
    for values in shared:
        values.setflags(write=False)


def arrivals(sensor: IdealSensor, seed: int, scenario: str) -> Array:
    """Return the arrival time of each scan at the trackers, ``(instants,)`` s, equal in all runs."""
    low, high = sensor.config.latency
    if low == high:
        return sensor.time + low
    return sensor.time + stream(seed, scenario, 0, f"latency of {sensor.name}").uniform(low, high, len(sensor.time))


def ideal_sensor(truth: Truth, name: str, config: Sensor, steps: Indices) -> IdealSensor:
    """Return the noise-free measurements of a synthesised sensor at the truth's ``steps``, which are indices."""
    motion = motion_at(truth, config, steps)
    pose, velocity, _ = motion
    target = by_arithmetic(np.stack([truth.px, truth.py, truth.vx, truth.vy])[:, steps])
    measurement = np.asarray(config.measure(target, pose[:, :, None, None], velocity[:, :, None, None]))
    polar_values = polar(truth, steps, motion)
    within = objects_in_view(truth, steps, config, motion, polar_values)
    visible = within & ~silent(config, truth.time[steps])[:, None, None]
    probability = detection_probability(config, polar_values)
    noise, time = config.noise_covariance(), truth.time[steps]
    bodies = None
    if config.effects:
        heading = truth.heading[steps]
        axis = np.stack([np.cos(heading), np.sin(heading)])
        size = truth.length[:, None], truth.width[:, None]
        bodies = Bodies(target, heading, axis, truth.yaw_rate[steps], *size, centre=target[:2])
    resolved = None if config.resolution is None else polar_values
    seen_by = name, config, steps, time, measurement, visible, within, probability
    return IdealSensor(*seen_by, *motion, noise, resolved, bodies=bodies)


def _recorded_sensor(truth: Truth, name: str, config: Sensor, measurements: Recorded) -> IdealSensor:
    if isinstance(measurements, RecordedDetections):
        shape = len(measurements.steps), len(truth.ids)
        no_measurements = np.full((len(config.components), *shape), np.nan), np.zeros(shape, dtype=bool)
        unlabelled = _recorded_sensor(truth, name, config, RecordedMeasurements(measurements.steps, *no_measurements))
        return replace(unlabelled, detections=measurements)
    steps, valid = measurements.steps, measurements.valid
    cycles = np.arange(len(steps)) if measurements.cycle is None else measurements.cycle
    _, first, cycle_index = np.unique(cycles, return_index=True, return_inverse=True)
    is_in_cycle = np.logical_or.reduceat(valid, first, axis=0)[cycle_index] if len(steps) else valid
    # An object detected at another instant of the cycle was not missed at this one.
    is_missed = ~is_in_cycle & np.isin(np.arange(len(steps)), first)[:, None]
    is_silent = silent(config, truth.time[steps])[:, None, None]
    ideal = ideal_sensor(truth, name, config, steps)
    is_in_view = ideal.in_view | valid[:, :, None]
    return replace(
        ideal,
        measurement=measurements.measurement[..., None],
        visible=(valid[:, :, None] | (is_missed[:, :, None] & ideal.in_view)) & ~is_silent,
        in_view=is_in_view,
        probability=np.broadcast_to(1.0, is_in_view.shape),
        polar=None,
        bodies=None,
        cycle_starts=first,
        recorded=True,
        alarms=measurements.alarms,
    )


def scan_rate(sensor: IdealSensor) -> float | None:
    """Return the scan rate, Hz: as configured, or from the median interval of recorded scans; None for one scan."""
    if not sensor.recorded:
        return sensor.config.rate_hz
    starts = sensor.time[sensor.cycle_starts]
    return float(1.0 / np.median(np.diff(starts))) if len(starts) > 1 else None


class ObjectMeasurements(NamedTuple):
    """Measurements of the objects by one sensor, in several runs, with noise."""

    measurement: Array
    """``(m, instants, objects, runs)`` measurement of each object; NaN where it is not detected."""
    detected: Mask
    """``(instants, objects, runs)`` whether the object is detected."""
    sensed: Sensed | None
    """Measurements before white noise; None for a sensor without effects."""


#: Measurements of one component made at a time, so that they fit into the processor's cache.
AT_A_TIME = 2**18


def sensor_measurements(
    sensor: IdealSensor, seed: int, scenario: str, runs: range
) -> Iterator[tuple[range, ObjectMeasurements]]:
    """Yield the numbers of a few runs with their measurements, until all of ``runs`` are measured."""
    size = max(1, AT_A_TIME // max(1, sensor.measurement[0, :, :, 0].size))
    for first in range(0, len(runs), size):
        part = runs[first : first + size]
        yield part, _measured(sensor, seed, scenario, part)


def _measured(sensor: IdealSensor, seed: int, scenario: str, runs: range) -> ObjectMeasurements:
    ideal, visible = of_runs(sensor.measurement, runs), of_runs(sensor.visible, runs)
    random = RunStreams(streams(seed, scenario, runs, sensor.name))
    draws, chance = random.standard_normal(ideal.shape[:-1]), random.random(visible.shape[:-1])
    sensed = None
    if sensor.bodies is None:
        detected = visible & (chance < of_runs(sensor.probability, runs))
    else:
        sensed = affected(sensor, seed, scenario, runs)
        detected = visible & (chance < sensed.probability)
        ideal = np.asarray(sensed.ideal()) + sensed.error
        draws = np.multiply(draws, sensed.scale, order="C")
    if sensor.recorded:
        detected = detected & np.isfinite(ideal).all(axis=0)
        noisy = difference(ideal, np.zeros_like(ideal), sensor.config.angular)
    else:
        noisy = noisy_measurements(sensor.config, ideal, draws)
    # A recorded measurement is the same in all runs; only its detection may differ.
    noisy = np.add(noisy, np.where(detected, 0.0, np.nan), out=noisy if noisy.shape[1:] == detected.shape else None)
    return ObjectMeasurements(noisy, detected, sensed)


def affected(sensor: IdealSensor, seed: int, scenario: str, runs: range) -> Sensed:
    """Return the measurements of a sensor with effects in the runs ``runs``, before white noise."""
    assert sensor.bodies is not None
    size, instants, objects = sensor.measurement.shape[:3]
    scale = np.ones((1, instants, objects, 1))
    sensed = Sensed(
        sensor.config,
        len(runs),
        sensor.time,
        sensor.pose[..., None],
        sensor.velocity[..., None],
        sensor.yaw_rate[..., None],
        sensor.bodies.of_runs(runs),
        of_runs(sensor.visible, runs),
        of_runs(sensor.probability, runs),
        scale=scale,
        slow_scale=scale,
        error=np.zeros((size, instants, objects, len(runs))),
    )
    for place, effect in enumerate(sensor.config.effects):
        sensed = answers.before(effect, sensed, effect_streams(sensor, place, seed, scenario, runs))
    return sensed


def effect_streams(sensor: IdealSensor, place: int, seed: int, scenario: str, runs: range) -> RunStreams:
    """Return a new random stream of each run for the sensor's effect with index ``place``."""
    return RunStreams(fast_streams(seed, scenario, runs, f"effect {place} of {sensor.name}"))


def noisy_measurements(config: Sensor, ideal: Array, draws: Array) -> Array:
    """Return ``ideal`` plus the sensor's noise, ``(m, ...)``; the standard normal ``draws`` are overwritten with it."""
    by_component = (slice(None), *(None,) * (ideal.ndim - 1))
    draws *= np.array(config.sigmas())[by_component]
    draws += ideal
    for angle in (draws[i] for i in config.angular):
        # Wrapping is slow, and most sensors never need it.
        if not (angle.min(initial=0.0) > -SURELY_WRAPPED and angle.max(initial=0.0) < SURELY_WRAPPED):
            angle[...] = wrap_angle(angle)
    return as_given(config, draws)


#: Wrapping leaves angles up to this size unchanged, rad.
SURELY_WRAPPED = 3.0


def as_given(config: Sensor, measurement: Array) -> Array:
    """Return measurements ``(m, ...)`` after the effects that act on noisy ones, such as rounding to a grid."""
    for effect in config.effects:
        measurement = answers.after(effect, measurement, config)
    return measurement


def hashed(values: Array, keys: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]:
    """Return ``(runs,)`` sums of the 32-bit halves of numbers ``(runs, ...)`` times random ``keys``, modulo 2^64.

    Source: Lemire and Kaser (2014), "Strongly universal string hashing is fast", MULTILINEAR: two lists of numbers
    share a hash with a probability of less than 2^-32.
    """
    halves = np.ascontiguousarray(values).reshape(len(values), -1).view(np.uint32)
    return np.asarray(np.einsum("rn,n->r", halves, keys))
