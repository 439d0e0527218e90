"""The measurements of a block of Monte-Carlo runs: synthesised, or as recorded."""

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
    """What one sensor would read without noise, or has read, at each of its instants."""

    name: str
    config: Sensor
    steps: Indices
    """``(instants,)`` indices into the truth."""
    time: Array
    """``(instants,)`` s."""
    measurement: Array
    """``(m, instants, objects, runs or 1)``."""
    visible: Mask
    """``(instants, objects, runs or 1)``: in view, and the sensor not silent."""
    in_view: Mask
    """``(instants, objects, runs or 1)``: present, in range and in the field of view, and not occluded."""
    probability: Array
    """``(instants, objects, runs or 1)`` that an object is detected where it is visible."""
    pose: Array
    """``(3, instants)``."""
    velocity: Array
    """``(2, instants)``."""
    yaw_rate: Array
    """``(instants,)`` rad/s."""
    noise_covariance: Array
    """``(m, m)``."""
    polar: Array | None = None
    """``(3, instants, objects, runs or 1)`` true range m, azimuth rad and range rate m/s, of a sensor of limited
    resolution."""
    cycle_starts: Indices = field(default_factory=lambda: np.arange(0))
    """``(cycles,)`` the first instant of each cycle, where the measurements are recorded."""
    bodies: Bodies | None = None
    """What it sees, of a sensor that has effects."""
    recorded: bool = False
    """Whether the measurements are as recorded: no noise is added, and NaN where the sensor missed an object."""
    detections: RecordedDetections | None = None
    """Those that are recorded where nothing says of which object they are."""
    alarms: RecordedAlarms | None = None
    """Recorded false alarms."""


def ideal_sensors(
    truth: Truth, sensors: Mapping[str, Sensor], recorded: Mapping[str, Recorded] | None = None
) -> list[IdealSensor]:
    """The side of sensing that is the same in every run.

    Args:
        truth: the motion.
        sensors: by name.
        recorded: what some of them have read.
    """
    return [
        _as_recorded(truth, name, config, recorded[name])
        if recorded and name in recorded
        else ideal_sensor(truth, name, config, firing_steps(config, truth.time))
        for name, config in sensors.items()
    ]


@dataclass(frozen=True)
class Measurements:
    """The scans of a block of runs, in the order in which a tracker gets them, and what no tracker may know."""

    scans: list[Scan]
    """Sorted by time, then in the scenario's order of sensors. With known identities the batch axis is
    ``(objects * runs,)``, objects slowest; with hidden ones ``measurement`` is ``(m, D, runs)`` and ``valid``
    ``(D, runs)``: in each run its detections first, then columns of NaN that are not valid."""
    digests: list[bytes]
    """A fingerprint of each run's measurements."""
    origins: list[Indices] = field(default_factory=list)
    """With hidden identities, for each scan ``(D, runs)``: the number of the object that a detection stems from (of a
    merged one, the one with the larger share), or ``FALSE_ALARM`` or ``PADDING``; ``UNKNOWN_ORIGIN`` where nothing says
    so. Where there is no truth, the number of the sensor's own track, or ``UNKNOWN_ORIGIN``."""
    merged: list[Indices] = field(default_factory=list)
    """With hidden identities, for each scan ``(D, runs)``: the second object of a merged detection, else -1."""

    def detected(self) -> dict[str, int]:
        """Return by sensor the number of detections of objects, over all scans and runs."""
        counts = dict.fromkeys((scan.sensor for scan in self.scans), 0)
        of_objects = [origins >= 0 for origins in self.origins] or [scan.valid for scan in self.scans]
        for scan, of_object in zip(self.scans, of_objects, strict=True):
            counts[scan.sensor] += int(np.count_nonzero(of_object))
        return counts


def sense_known(sensors: Sequence[IdealSensor], seed: int, scenario: str, runs: range) -> Measurements:
    """The measurements of some of the runs. A run's noise depends on nothing but its number and the seed."""
    scans: list[Scan] = []
    hashes = [hashlib.sha256() for _ in runs]
    for place, sensor in enumerate(sensors):
        size, instants, objects = sensor.measurement.shape[:3]
        measurement = np.empty((instants, size, objects, len(runs)))
        valid = np.empty((instants, objects, len(runs)), dtype=bool)
        keys = stream(0, "", 0, "fingerprints").integers(2**64, size=2 * size * instants * objects, dtype=np.uint64)
        for part, (noisy, detected, _) in sensor_measurements(sensor, seed, scenario, runs):
            some = slice(part.start - runs.start, part.stop - runs.start)
            measurement[..., some], valid[..., some] = np.swapaxes(noisy, 0, 1), detected
            for run, total in zip(hashes[some], hashed(np.moveaxis(noisy, -1, 0), keys), strict=True):
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
    """The scan at instant ``k`` of the sensor, the ``place``-th of the scenario, which arrives at a time in s."""
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
    """One tracker must not change what the next one reads."""
    for values in shared:
        values.setflags(write=False)


def arrivals(sensor: IdealSensor, seed: int, scenario: str) -> Array:
    """``(instants,)`` when each scan reaches a tracker, s: the same in every run, so that all take it at once."""
    low, high = sensor.config.latency
    if low == high:
        return sensor.time + low
    return sensor.time + stream(seed, scenario, 0, f"latency of {sensor.name}").uniform(low, high, len(sensor.time))


def ideal_sensor(truth: Truth, name: str, config: Sensor, steps: Indices) -> IdealSensor:
    """What a synthesised sensor would read without noise at some steps of the truth."""
    motion = motion_at(truth, config, steps)
    pose, velocity, _ = motion
    target = by_arithmetic(np.stack([truth.px, truth.py, truth.vx, truth.vy])[:, steps])
    measurement = np.asarray(config.measure(target, pose[:, :, None, None], velocity[:, :, None, None]))
    seen = polar(truth, steps, motion)
    within = objects_in_view(truth, steps, config, motion, seen)
    visible = within & ~silent(config, truth.time[steps])[:, None, None]
    probability = detection_probability(config, seen)
    noise, time = config.noise_covariance(), truth.time[steps]
    bodies = None
    if config.effects:
        heading = truth.heading[steps]
        axis = np.stack([np.cos(heading), np.sin(heading)])
        size = truth.length[:, None], truth.width[:, None]
        bodies = Bodies(target, heading, axis, truth.yaw_rate[steps], *size, centre=target[:2])
    resolved = None if config.resolution is None else seen
    seen_by = name, config, steps, time, measurement, visible, within, probability
    return IdealSensor(*seen_by, *motion, noise, resolved, bodies=bodies)


def _as_recorded(truth: Truth, name: str, config: Sensor, measurements: Recorded) -> IdealSensor:
    if isinstance(measurements, RecordedDetections):
        shape = len(measurements.steps), len(truth.ids)
        none = np.full((len(config.components), *shape), np.nan), np.zeros(shape, dtype=bool)
        unlabelled = _as_recorded(truth, name, config, RecordedMeasurements(measurements.steps, *none))
        return replace(unlabelled, detections=measurements)
    steps, valid = measurements.steps, measurements.valid
    cycle = np.arange(len(steps)) if measurements.cycle is None else measurements.cycle
    _, first, number = np.unique(cycle, return_index=True, return_inverse=True)
    in_cycle = np.logical_or.reduceat(valid, first, axis=0)[number] if len(steps) else valid
    # An object that a cycle detected at another of its instants was not missed at this one.
    missed = ~in_cycle & np.isin(np.arange(len(steps)), first)[:, None]
    silenced = silent(config, truth.time[steps])[:, None, None]
    ideal = ideal_sensor(truth, name, config, steps)
    within = ideal.in_view | valid[:, :, None]
    return replace(
        ideal,
        measurement=measurements.measurement[..., None],
        visible=(valid[:, :, None] | (missed[:, :, None] & ideal.in_view)) & ~silenced,
        in_view=within,
        probability=np.broadcast_to(1.0, within.shape),
        polar=None,
        bodies=None,
        cycle_starts=first,
        recorded=True,
        alarms=measurements.alarms,
    )


def scan_rate(sensor: IdealSensor) -> float | None:
    """Scans per second, Hz: as stated, or of recorded ones the median; None where there is a single one."""
    if not sensor.recorded:
        return sensor.config.rate_hz
    starts = sensor.time[sensor.cycle_starts]
    return float(1.0 / np.median(np.diff(starts))) if len(starts) > 1 else None


class ObjectMeasurements(NamedTuple):
    """What one sensor has measured of the objects in some runs."""

    measurement: Array
    """``(m, instants, objects, runs)``, NaN where not detected."""
    detected: Mask
    """``(instants, objects, runs)``."""
    sensed: Sensed | None
    """Before its white noise, of a sensor that has effects."""


#: Measurements of a component that are made at a time: as many as the cache of a processor holds.
AT_A_TIME = 2**18


def sensor_measurements(
    sensor: IdealSensor, seed: int, scenario: str, runs: range
) -> Iterator[tuple[range, ObjectMeasurements]]:
    """The measurements of some runs, a few runs at a time."""
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
    # What was recorded is the same in all runs, which may detect it or not.
    noisy = np.add(noisy, np.where(detected, 0.0, np.nan), out=noisy if noisy.shape[1:] == detected.shape else None)
    return ObjectMeasurements(noisy, detected, sensed)


def affected(sensor: IdealSensor, seed: int, scenario: str, runs: range) -> Sensed:
    """Some runs of a sensor that has effects, before its white noise."""
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
    """What an effect, the ``place``-th of the sensor, draws from: for each of its methods from the start."""
    return RunStreams(fast_streams(seed, scenario, runs, f"effect {place} of {sensor.name}"))


def noisy_measurements(config: Sensor, ideal: Array, draws: Array) -> Array:
    """Measurements ``(m, ...)`` with the sensor's noise, which ``draws`` of a standard normal become."""
    own = (slice(None), *(None,) * (ideal.ndim - 1))
    draws *= np.array(config.sigmas())[own]
    draws += ideal
    for angle in (draws[i] for i in config.angular):
        # Of most sensors no angle needs to be wrapped.
        if not (angle.min(initial=0.0) > -SURELY_WRAPPED and angle.max(initial=0.0) < SURELY_WRAPPED):
            angle[...] = wrap_angle(angle)
    return as_given(config, draws)


#: Angles up to this are what they were once they are wrapped, rad.
SURELY_WRAPPED = 3.0


def as_given(config: Sensor, measurement: Array) -> Array:
    """Measurements ``(m, ...)`` as the sensor gives them."""
    for effect in config.effects:
        measurement = answers.after(effect, measurement, config)
    return measurement


def hashed(values: Array, keys: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]:
    """``(runs,)`` hashes of numbers ``(runs, ...)``: the sums of their halves times random ``keys``, modulo 2^64.

    Source: Lemire and Kaser (2014), "Strongly universal string hashing is fast", MULTILINEAR: two lists of numbers have
    the same with a probability of less than 2^-32.
    """
    halves = np.ascontiguousarray(values).reshape(len(values), -1).view(np.uint32)
    return np.asarray(np.einsum("rn,n->r", halves, keys))
