"""Recorded drive, and its truth and measurements on a grid of times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from decimal import Decimal
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import KINEMATICS, Array, Indices, Observer, RecordedAlarms, RecordedMeasurements, Truth
from trackbench.base.units import wrap_angle
from trackbench.models.sensors import SENSOR_MODELS
from trackbench.truth.config.recording import ReferenceTruth
from trackbench.truth.frames import fixed_observer
from trackbench.truth.recorded.cycles import Cycles, cycles


class Motion(NamedTuple):
    """Recorded motion of one body, arrays ``(rows,)``, at strictly increasing times."""

    time: Array
    """``(rows,)`` time of each row from the truth's first instant, s."""
    px: Array
    py: Array
    vx: Array
    vy: Array
    heading: Array | None = None
    """``(rows,)`` heading, rad; None if not stated: the direction of motion is used."""
    yaw_rate: Array | None = None
    """``(rows,)`` yaw rate, rad/s; None if not stated: the rate of change of the heading is used."""
    length: Array | None = None
    """``(rows,)`` length of the body, m; None if not stated."""
    width: Array | None = None
    """``(rows,)`` width of the body, m; None if not stated."""


@dataclass(frozen=True)
class RowOrder:
    """Extent to which the rows of a file were out of order or repeated, before they were sorted."""

    rows: int
    backwards: int
    """Number of rows with an earlier time than a preceding row of the same object."""
    largest_step_back: float
    """Largest step back in time between neighbouring rows of an object, s."""
    duplicates: int
    """Number of rows left out because the object already has a row with that time."""


class Log(NamedTuple):
    """Recorded measurements of one sensor, one row for each detection, sorted by time."""

    time: Array
    """``(rows,)`` time of each detection from the truth's first instant, s."""
    object: Indices
    """``(rows,)`` index of each detection's object."""
    measurement: Array
    """``(m, rows)`` measurement of each detection, in SI units and radians; angles are not wrapped."""
    scans: Array
    """``(scans,)`` sorted times of all known scans, s, including scans without a detection."""
    order: RowOrder
    alarm_time: Array = np.zeros(0)
    """``(alarms,)`` times of the false alarms (rows without an object), s, sorted."""
    alarm_measurement: Array = np.zeros((0, 0))
    """``(m, alarms)`` measurements of the false alarms."""


class Scans(NamedTuple):
    """Unlabelled scans of one sensor, sorted by time."""

    time: Array
    """``(scans,)`` time of each scan, the first instant of its measurement cycle, s."""
    scan: Indices
    """``(rows,)`` index of each detection's scan."""
    measurement: Array
    """``(m, rows)`` measurement of each detection, angles wrapped to (-pi, pi]."""
    own_track: Indices
    """``(rows,)`` index of the sensor's own track that the detection belongs to; -1 for none."""
    own_tracks: tuple[str, ...]
    duplicates: int
    """Number of rows left out because an earlier row has the same time and slot in the sensor's list."""
    copies: int = 0
    """Number of detections left out because an older track of the sensor is close to them."""


@dataclass(frozen=True)
class Drive:
    """Content of a recording's files: motion of objects and observer, measurements, don't-care boxes."""

    motions: dict[str, Motion]
    """Motion of each object, by name."""
    order: RowOrder
    """Counts of rows of the truth that were out of order or repeated."""
    observer: Motion | None
    """Motion of the observer; None for a fixed point."""
    logs: dict[str, Log]
    """Measurements with known objects, by name of the sensor."""
    source: dict[str, Any]
    """Name of each file and its number of rows, stored in the result."""
    detections: dict[str, Scans] = field(default_factory=dict)
    """Scans whose detections have no known objects, by name of the sensor."""
    frames: Array = field(default_factory=lambda: np.zeros(0))
    """``(frames,)`` all times of the truth's rows, s; sorted."""
    boxes: Array = field(default_factory=lambda: np.zeros((6, 0)))
    """``(6, boxes)`` don't-care boxes, where nothing is scored: time, x, y, heading, half length and half width."""
    kinds: dict[str, str] = field(default_factory=dict)
    """Class of each object, by name; empty if classes are not read."""

    start: Decimal = Decimal(0)
    """Reading of the files' clock at the truth's first instant, s."""

    @property
    def has_truth(self) -> bool:
        """Whether the recording has the motion of objects."""
        return bool(self.motions)

    @property
    def sensors(self) -> list[str]:
        """Names of the sensors with recorded measurements."""
        return [*self.logs, *self.detections]

    def span(self, number: int) -> tuple[float, float]:
        """Return the first and last time, s, at which the object with index ``number`` and the observer are known."""
        bodies = [list(self.motions.values())[number], *([self.observer] if self.observer else [])]
        return max(float(m.time[0]) for m in bodies), min(float(m.time[-1]) for m in bodies)

    def inside(self, log: Log) -> Log:
        """Return the detections of ``log`` made while the motion of their object and of the observer is known."""
        spans = np.array([self.span(number) for number in range(len(self.motions))])
        is_inside = (log.time >= spans[log.object, 0]) & (log.time <= spans[log.object, 1])
        first, last = spans[:, 0].min(), spans[:, 1].max()
        scans = log.scans[(log.scans >= first) & (log.scans <= last)]
        is_alarm_inside = (log.alarm_time >= first) & (log.alarm_time <= last)
        return log._replace(
            time=log.time[is_inside],
            object=log.object[is_inside],
            measurement=log.measurement[:, is_inside],
            scans=scans,
            alarm_time=log.alarm_time[is_alarm_inside],
            alarm_measurement=log.alarm_measurement[:, is_alarm_inside],
        )

    def framed(self, time: Array) -> Array:
        """Return those times that lie between the truth's first and last row; all times if there is no truth."""
        return time if not self.has_truth else _between(time, float(self.frames[0]), float(self.frames[-1]))

    def clipped(self) -> Drive:
        """Return the drive with only the labelled detections made while truth and observer are known."""
        return replace(self, logs={name: self.inside(log) for name, log in self.logs.items()})


def row_order(time: Array, owner: Indices) -> tuple[Indices, RowOrder]:
    """Sort rows by time, remove repeated rows of an object, and count both.

    Args:
        time: ``(rows,)`` times, s.
        owner: ``(rows,)`` index of each row's object.

    Returns:
        Indices of the remaining rows, the first of each object and time, in order of time; and the counts.
    """
    instants, instant = np.unique(time, return_inverse=True)
    # Files may be sorted by object, so that time only increases within an object.
    by_owner = np.argsort(owner, kind="stable")
    place = instant[by_owner] + owner[by_owner] * len(instants)
    steps = np.diff(time[by_owner])[np.diff(owner[by_owner]) == 0]
    sorted_rows = np.argsort(time, kind="stable")
    pairs = instant[sorted_rows] + owner[sorted_rows] * len(instants)
    kept = np.sort(np.unique(pairs, return_index=True)[1])
    order = RowOrder(
        rows=len(time),
        backwards=int((place < np.maximum.accumulate(place)).sum()),
        largest_step_back=float(max(0.0, -steps.min(initial=0.0))),
        duplicates=len(time) - len(kept),
    )
    return sorted_rows[kept], order


def rows_of_each(owner: Indices, count: int) -> list[Indices]:
    """Return the row indices of each of ``count`` objects, in ascending order."""
    order = np.argsort(owner, kind="stable")
    return np.split(order, np.searchsorted(owner[order], np.arange(1, count)))


def truth_on_grid(config: ReferenceTruth, drive: Drive, times: Array) -> Truth:
    """Return the motion of all objects at ``times``, interpolated linearly between recorded instants.

    Args:
        config: the scenario's ``truth``.
        drive: content of the files.
        times: ``(steps,)`` times of the result, s, increasing.
    """
    motions = drive.motions
    columns = [_on_grid(motion, times) for motion in motions.values()]
    kinematics: dict[str, Any] = dict.fromkeys(KINEMATICS, np.zeros((len(times), 0, 1)))
    if columns:
        kinematics = {name: np.stack([column[name] for column in columns], axis=1)[:, :, None] for name in KINEMATICS}
    ends = np.array([(motion.time[0], motion.time[-1]) for motion in motions.values()]).reshape(-1, 2)
    observer = drive.observer
    return Truth(
        time=times,
        ids=tuple(motions),
        **kinematics,
        alive=(times[:, None] >= ends[:, 0]) & (times[:, None] <= ends[:, 1]),
        length=np.array([config.length_m if m.length is None else np.median(m.length) for m in motions.values()]),
        width=np.array([config.width_m if m.width is None else np.median(m.width) for m in motions.values()]),
        observer=fixed_observer(config.observer, len(times)) if observer is None else carrier(observer, times),
        start=drive.start,
        source=drive.source,
        known=drive.has_truth,
    )


def scan_cycles(drive: Drive) -> dict[str, Cycles]:
    """Return the measurement cycles of each sensor by name."""
    return {name: cycles(log.time, log.object, log.scans) for name, log in drive.logs.items()}


def grid(drive: Drive, cycles_by_sensor: Mapping[str, Cycles]) -> Array:
    """Return the distinct times of the truth's rows and of all scans, sorted, while the observer is known.

    Raises:
        InputError: the observer is known at fewer than half of the times.
    """
    row_times = [m.time for m in drive.motions.values()] + [sensor.instants for sensor in cycles_by_sensor.values()]
    times = np.unique(np.concatenate([*row_times, *(drive.framed(scans.time) for scans in drive.detections.values())]))
    if drive.observer is None:
        return times
    ends = float(drive.observer.time[0]), float(drive.observer.time[-1])
    inside = _between(times, *ends)
    _require_half(inside, times, ends, "times of the truth" if drive.has_truth else "measurements", "truth.ego")
    return inside


def measurements_on_grid(log: Log, kind: str, cycles: Cycles, times: Array, objects: int) -> RecordedMeasurements:
    """Return a sensor's measurements by scan and object, with angles wrapped to (-pi, pi].

    Args:
        log: detections of the sensor, at most one for each time and object.
        kind: kind of the sensor, such as radar.
        cycles: measurement cycles of the sensor.
        times: ``(steps,)`` times of the truth, including all times of the log.
        objects: number of objects.
    """
    model = SENSOR_MODELS[kind]
    is_inside = (cycles.instants >= times[0]) & (cycles.instants <= times[-1])
    instants = cycles.instants[is_inside]
    measurement = np.full((len(model.components), len(instants), objects), np.nan)
    measurement[:, np.searchsorted(instants, log.time), log.object] = log.measurement
    for i in model.angular:
        measurement[i] = wrap_angle(measurement[i])
    valid = np.isfinite(measurement).all(axis=0)
    alarms = None
    if len(log.alarm_time):
        is_kept = np.isin(log.alarm_time, instants)
        values = log.alarm_measurement[:, is_kept]
        for i in model.angular:
            values[i] = wrap_angle(values[i])
        alarms = RecordedAlarms(np.searchsorted(instants, log.alarm_time[is_kept]), values)
    return RecordedMeasurements(np.searchsorted(times, instants), measurement, valid, cycles.cycle[is_inside], alarms)


def left_out(drive: Drive, clipped: Drive, times: Array, *, hidden: bool) -> dict[str, dict[str, int]]:
    """Count the unused rows of the truth and of each sensor, by reason; reasons that did not occur are left out.

    With ``hidden`` identities, rows without an object are used, as false alarms.
    """
    result = {"truth": {"of an object and a time that came before": drive.order.duplicates}}
    if drive.has_truth and (observer := drive.observer) is not None:
        rows = np.concatenate([motion.time for motion in drive.motions.values()])
        outside = int(((rows < observer.time[0]) | (rows > observer.time[-1])).sum())
        result["truth"]["outside the time of the observer"] = outside
    for name, log in drive.logs.items():
        result[name] = {
            "of an object and a time that came before": log.order.duplicates,
            "outside the time of the truth": len(log.time) - len(clipped.logs[name].time),
            "of no object": 0 if hidden else len(log.alarm_time),
        }
    whose = "truth" if drive.has_truth else "observer"
    for name, scans in drive.detections.items():
        result[name] = {
            "of a slot and a time that came before": scans.duplicates,
            "that are copies of another of their cycle": scans.copies,
            f"outside the time of the {whose}": int((~np.isin(scans.time, times))[scans.scan].sum()),
        }
    occurring = {name: {reason: n for reason, n in counts.items() if n} for name, counts in result.items()}
    return {name: counts for name, counts in occurring.items() if counts}


def require_measurements(drive: Drive, clipped: Drive) -> None:
    """Require that each sensor's measurements lie within the time of the truth and the observer.

    Raises:
        InputError: fewer than half of a sensor's measurements lie within it.
    """
    if drive.observer is not None:
        grid(drive, {})
    for name, log in drive.logs.items():
        log_inside, spans = clipped.logs[name], [drive.span(number) for number in range(len(drive.motions))]
        ends = min(first for first, _ in spans), max(last for _, last in spans)
        time = np.concatenate([log.time, log.alarm_time])
        inside = _between(time, *ends) if len(log_inside.time) + len(log_inside.alarm_time) else time[:0]
        _require_half(inside, time, ends, f"measurements of {name}", f"truth.readings.{name}")
    for name, scans in drive.detections.items():
        if drive.has_truth:
            ends = float(drive.frames[0]), float(drive.frames[-1])
            time = scans.time[scans.scan]
            _require_half(drive.framed(time), time, ends, f"measurements of {name}", f"truth.readings.{name}")


def _between(time: Array, first: float, last: float) -> Array:
    return np.asarray(time[(time >= first) & (time <= last)])


def _require_half(inside: Array, time: Array, ends: tuple[float, float], what: str, key: str) -> None:
    """Raise an error if ``inside``, the times within ``ends``, are under half of ``time``; hint at a wrong unit."""
    if len(inside) and 2 * len(inside) >= len(time):
        return
    span, when = (f"from {a:.12g} to {b:.12g} s" for a, b in np.round([[time.min(), time.max()], ends], 2))
    message = f"only {len(inside)} of {len(time)} {what} ({span}) lie within the time of the truth or observer ({when})"
    raise InputError(f"{message}: check the units of time", key=key)


def carrier(motion: Motion, times: Array) -> Observer:
    """Return the recorded observer interpolated at ``times`` s, its heading the short way round."""
    assert motion.heading is not None
    yaw = np.unwrap(motion.heading)
    rate = slope(yaw, motion.time) if motion.yaw_rate is None else motion.yaw_rate

    def at(values: Array) -> Array:
        return np.interp(times, motion.time, values)

    return Observer(at(motion.px), at(motion.py), at(yaw), at(motion.vx), at(motion.vy), at(rate))


def _on_grid(motion: Motion, times: Array) -> dict[str, Array]:
    def at(values: Array) -> Array:
        return np.interp(times, motion.time, values)

    vx, vy = at(motion.vx), at(motion.vy)
    course = np.arctan2(vy, vx)
    heading = course if motion.heading is None else wrap_angle(at(np.unwrap(motion.heading)))
    turning = slope(np.unwrap(course if motion.heading is None else heading), times)
    speed = np.hypot(vx, vy)
    return {
        "px": at(motion.px),
        "py": at(motion.py),
        "heading": heading,
        "course": course,
        "speed": speed,
        "acceleration": slope(speed, times),
        "yaw_rate": turning if motion.yaw_rate is None else at(motion.yaw_rate),
    }


def slope(values: Array, times: Array) -> Array:
    """Return the rate of change of ``values`` at each time, ``(steps,)``; zero for a single value."""
    return np.gradient(values, times) if len(times) > 1 else np.zeros_like(values)
