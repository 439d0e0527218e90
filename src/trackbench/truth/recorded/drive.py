"""A recorded drive, and the grid of times on which it becomes a truth."""

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
    """The recorded motion of one body, each ``(rows,)``, at strictly increasing times."""

    time: Array
    """s from the truth's first instant."""
    px: Array
    py: Array
    vx: Array
    vy: Array
    heading: Array | None = None
    """rad; None: the course."""
    yaw_rate: Array | None = None
    """rad/s; None: from the heading."""
    length: Array | None = None
    """m; None: not stated."""
    width: Array | None = None
    """m; None: not stated."""


@dataclass(frozen=True)
class RowOrder:
    """The order in which rows stand in a file, before they are sorted."""

    rows: int
    backwards: int
    """Rows with an earlier time than one before them."""
    largest_step_back: float
    """s."""
    duplicates: int
    """Rows of the same object at the same time as a row before, which are left out."""


class Log(NamedTuple):
    """The recorded measurements of one sensor, one row a detection, sorted by time."""

    time: Array
    """``(rows,)`` s from the truth's first instant."""
    object: Indices
    """``(rows,)`` number of the object."""
    measurement: Array
    """``(m, rows)`` in SI units and radians; angles as they are written, not wrapped."""
    scans: Array
    """``(scans,)`` all times at which the file says that the sensor looked, those without a detection too; sorted."""
    order: RowOrder
    alarm_time: Array = np.zeros(0)
    """``(alarms,)`` s, of the rows of no object, sorted."""
    alarm_measurement: Array = np.zeros((0, 0))
    """``(m, alarms)``"""


class Scans(NamedTuple):
    """Of one sensor, sorted by time."""

    time: Array
    """``(scans,)`` the first instant of each cycle, s."""
    scan: Indices
    """``(rows,)``"""
    measurement: Array
    """``(m, rows)``, angles wrapped."""
    own_track: Indices
    """``(rows,)``"""
    own_tracks: tuple[str, ...]
    duplicates: int
    """Rows of the same slot at the same time as a row before, which are left out."""
    copies: int = 0
    """Detections beside another of the same object, which are left out."""


@dataclass(frozen=True)
class Drive:
    """Content of the files of a recording."""

    motions: dict[str, Motion]
    """By object."""
    order: RowOrder
    """Of the truth's rows."""
    observer: Motion | None
    """What carries the sensors; None: a fixed point."""
    logs: dict[str, Log]
    """By sensor."""
    source: dict[str, Any]
    """What the result says of the files."""
    detections: dict[str, Scans] = field(default_factory=dict)
    """By sensor whose rows nobody labelled."""
    frames: Array = field(default_factory=lambda: np.zeros(0))
    """``(frames,)`` s, all times of the truth's rows; sorted."""
    boxes: Array = field(default_factory=lambda: np.zeros((6, 0)))
    """``(6, boxes)`` don't-care boxes: time, x, y, heading, half length and half width."""
    kinds: dict[str, str] = field(default_factory=dict)
    """The class of each object, where classes count."""

    start: Decimal = Decimal(0)
    """s of the files' clock at 0 s."""

    @property
    def has_truth(self) -> bool:
        """Whether anything says where objects were."""
        return bool(self.motions)

    @property
    def sensors(self) -> list[str]:
        """Those with recorded measurements."""
        return [*self.logs, *self.detections]

    def span(self, number: int) -> tuple[float, float]:
        """From when to when the truth of an object, and of the observer, is known, s."""
        bodies = [list(self.motions.values())[number], *([self.observer] if self.observer else [])]
        return max(float(m.time[0]) for m in bodies), min(float(m.time[-1]) for m in bodies)

    def inside(self, log: Log) -> Log:
        """The rows of a log within the span of their object's truth."""
        spans = np.array([self.span(number) for number in range(len(self.motions))])
        kept = (log.time >= spans[log.object, 0]) & (log.time <= spans[log.object, 1])
        first, last = spans[:, 0].min(), spans[:, 1].max()
        scans = log.scans[(log.scans >= first) & (log.scans <= last)]
        alarms = (log.alarm_time >= first) & (log.alarm_time <= last)
        return log._replace(
            time=log.time[kept],
            object=log.object[kept],
            measurement=log.measurement[:, kept],
            scans=scans,
            alarm_time=log.alarm_time[alarms],
            alarm_measurement=log.alarm_measurement[:, alarms],
        )

    def framed(self, time: Array) -> Array:
        """Return the times within the time of the truth's rows; all where there is no truth."""
        return time if not self.has_truth else _between(time, float(self.frames[0]), float(self.frames[-1]))

    def clipped(self) -> Drive:
        """The drive without measurements outside the span of the truth."""
        return replace(self, logs={name: self.inside(log) for name, log in self.logs.items()})


def row_order(time: Array, owner: Indices) -> tuple[Indices, RowOrder]:
    """Sort rows by time, without duplicates, and count what had to be done for that.

    Args:
        time: ``(rows,)``.
        owner: ``(rows,)`` number of the object of each.

    Returns:
        Numbers of the rows that are kept: of several of one object at one time, the first.
    """
    instants, instant = np.unique(time, return_inverse=True)
    # Rows may stand object by object: only within those of one does time go on.
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
    """Return the numbers of the rows of each of ``count`` owners, in their order."""
    order = np.argsort(owner, kind="stable")
    return np.split(order, np.searchsorted(owner[order], np.arange(1, count)))


def truth_on_grid(config: ReferenceTruth, drive: Drive, times: Array) -> Truth:
    """The motion of all objects at ``times``, between the recorded instants by linear interpolation.

    Args:
        config: the scenario's.
        drive: what the files say.
        times: ``(steps,)`` s, increasing.
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
    """When each sensor looked, by name."""
    return {name: cycles(log.time, log.object, log.scans) for name, log in drive.logs.items()}


def grid(drive: Drive, looked: Mapping[str, Cycles]) -> Array:
    """All times of the truth's rows and of the scans, each once and in order, as far as the observer is known.

    Raises:
        InputError: the observer is known at fewer than half of them.
    """
    own = [m.time for m in drive.motions.values()] + [sensor.instants for sensor in looked.values()]
    times = np.unique(np.concatenate([*own, *(drive.framed(of.time) for of in drive.detections.values())]))
    if drive.observer is None:
        return times
    ends = float(drive.observer.time[0]), float(drive.observer.time[-1])
    inside = _between(times, *ends)
    _require_half(inside, times, ends, "times of the truth" if drive.has_truth else "measurements", "truth.ego")
    return inside


def measurements_on_grid(log: Log, kind: str, looked: Cycles, times: Array, objects: int) -> RecordedMeasurements:
    """A sensor's measurements by scan and object, its angles wrapped to (-pi, pi].

    Args:
        log: at most one row for each time and object.
        kind: of the sensor.
        looked: when it looked.
        times: ``(steps,)`` those of the truth, with all of the log's among them.
        objects: how many there are.
    """
    model = SENSOR_MODELS[kind]
    there = (looked.instants >= times[0]) & (looked.instants <= times[-1])
    instants = looked.instants[there]
    measurement = np.full((len(model.components), len(instants), objects), np.nan)
    measurement[:, np.searchsorted(instants, log.time), log.object] = log.measurement
    for i in model.angular:
        measurement[i] = wrap_angle(measurement[i])
    valid = np.isfinite(measurement).all(axis=0)
    alarms = None
    if len(log.alarm_time):
        kept = np.isin(log.alarm_time, instants)
        values = log.alarm_measurement[:, kept]
        for i in model.angular:
            values[i] = wrap_angle(values[i])
        alarms = RecordedAlarms(np.searchsorted(instants, log.alarm_time[kept]), values)
    return RecordedMeasurements(np.searchsorted(times, instants), measurement, valid, looked.cycle[there], alarms)


def left_out(drive: Drive, clipped: Drive, times: Array, *, hidden: bool) -> dict[str, dict[str, int]]:
    """Count the rows of the truth and of each sensor by why they are not used; what did not occur is not named.

    With ``hidden`` identities rows of no object are false alarms.
    """
    result = {"truth": {"of an object and a time that came before": drive.order.duplicates}}
    if drive.has_truth and (seen := drive.observer) is not None:
        rows = np.concatenate([motion.time for motion in drive.motions.values()])
        outside = int(((rows < seen.time[0]) | (rows > seen.time[-1])).sum())
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
    counts = {name: {why: count for why, count in of.items() if count} for name, of in result.items()}
    return {name: of for name, of in counts.items() if of}


def require_measurements(drive: Drive, clipped: Drive) -> None:
    """Make sure that measurements of every sensor are within the time of the truth and of its observer.

    Raises:
        InputError: fewer than half are.
    """
    if drive.observer is not None:
        grid(drive, {})
    for name, log in drive.logs.items():
        kept, spans = clipped.logs[name], [drive.span(number) for number in range(len(drive.motions))]
        ends = min(first for first, _ in spans), max(last for _, last in spans)
        time = np.concatenate([log.time, log.alarm_time])
        inside = _between(time, *ends) if len(kept.time) + len(kept.alarm_time) else time[:0]
        _require_half(inside, time, ends, f"measurements of {name}", f"truth.readings.{name}")
    for name, of in drive.detections.items():
        if drive.has_truth:
            ends = float(drive.frames[0]), float(drive.frames[-1])
            time = of.time[of.scan]
            _require_half(drive.framed(time), time, ends, f"measurements of {name}", f"truth.readings.{name}")


def _between(time: Array, first: float, last: float) -> Array:
    return np.asarray(time[(time >= first) & (time <= last)])


def _require_half(inside: Array, time: Array, ends: tuple[float, float], what: str, key: str) -> None:
    """Refuse times of which fewer than half are inside the span of another file, as those of another unit are."""
    if len(inside) and 2 * len(inside) >= len(time):
        return
    own, other = (f"from {begin:.12g} to {end:.12g} s" for begin, end in np.round([[time.min(), time.max()], ends], 2))
    message = f"only {len(inside)} of {len(time)} {what} ({own}) lie within the time of the truth or observer ({other})"
    raise InputError(f"{message}: check the units of time", key=key)


def carrier(motion: Motion, times: Array) -> Observer:
    """A recorded observer at ``times``; its heading is interpolated the short way round."""
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
    """``(steps,)`` rate of change; zero of a single value."""
    return np.gradient(values, times) if len(times) > 1 else np.zeros_like(values)
