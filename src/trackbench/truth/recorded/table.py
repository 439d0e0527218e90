"""A drive from tables whose columns and units the scenario names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from trackbench.base.errors import InputError, nearest
from trackbench.base.types import Array, Indices
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.truth import jumps
from trackbench.truth.config import RecordingOptions
from trackbench.truth.config.columns import (
    MOTION_QUANTITIES,
    MeasurementColumns,
    MotionColumns,
    ObserverColumns,
    TruthColumns,
    Units,
)
from trackbench.truth.config.logs import find_log
from trackbench.truth.recorded.drive import Drive, Log, Motion, RowOrder, row_order, slope
from trackbench.truth.recorded.mcap import LogPart
from trackbench.truth.recorded.reference import LARGEST_M, dont_care_boxes, ignored_rows, moved_to_centre
from trackbench.truth.recorded.rows import Rows, read_table, seconds_from, time_stamps
from trackbench.truth.recorded.scans import Scans, column_measurements, columns_of, scans_of

#: What the object is called where the file does not name it.
OBJECT = "object"


def load_tables(config: RecordingOptions, kinds: Mapping[str, str], folder: Path) -> Drive:
    """The motion of all objects, and the measurements of the sensors whose columns are named.

    Raises:
        InputError: a file cannot be read, or a row of it is damaged.
    """
    assert config.columns is not None
    assert config.path is not None
    columns, units = config.columns, config.units
    observer, ignore = columns.observer, config.reference.ignore
    inside = [entry for entry in config.measurements.values() if entry.path is None]
    wanted = [columns.time, columns.object, *columns.given.values()]
    wanted += [column for entry in inside for column in (entry.time, *_own(entry, columns))]
    wanted += [columns.kind, *ignore, *(observer.given.values() if observer is not None and not observer.path else ())]
    file = find_log(config.path, folder, "truth.path")
    table = read_table(file, config.format, wanted, LogPart("boxes", columns.topic))
    stamps = time_stamps(table, columns.time, units.factor("time", columns.units.get("time")))
    start = min(stamps)
    seconds = seconds_from(start, stamps)
    if seconds.max() > jumps.LONGEST:
        row = int(np.argmax(seconds))
        raise table.error(row, f"{columns.time}: {jumps.why_too_long(seconds[row])}")
    dropped = ignored_rows(table, ignore)
    if dropped.all():
        raise InputError("every row is a don't-care box, so there is no object", key="truth.reference.ignore")
    own = table.only(~dropped) if dropped.any() else table
    motions, order = _motions(own, columns, seconds[~dropped], config)
    boxes = dont_care_boxes(table.only(dropped), columns, seconds[dropped], config)
    carrier = None
    if observer is not None and observer.path is not None:
        time = observer.time or columns.time
        own_rows = find_log(observer.path, folder, "truth.columns.observer.path")
        source = read_table(own_rows, config.format, [time, *observer.given.values()], LogPart("frame", observer.frame))
        times = seconds_from(start, time_stamps(source, time, units.factor("time", observer.units.get("time"))))
        carrier = observer_motion(source, observer, times, units)
    elif observer is not None:
        _require_one_pose_a_time(table, observer, seconds)
        carrier = observer_motion(table, observer, seconds, units)
    logs: dict[str, Log] = {}
    detections: dict[str, Scans] = {}
    for name, entry in config.measurements.items():
        source, unlabelled = own, config.unlabelled(name)
        if entry.path is not None:
            file = find_log(entry.path, folder, f"truth.readings.{name}.path")
            needed = columns_of(entry) if unlabelled else _own(entry, columns)
            source = read_table(
                file, config.format, [entry.time or columns.time, *needed], LogPart("detections", entry.topic)
            )
        unit = entry.units.get("time", columns.units.get("time"))
        times = seconds_from(start, time_stamps(source, entry.time or columns.time, units.factor("time", unit)))
        times = times + entry.time_offset_s
        if unlabelled:
            detections[name] = scans_of(source, entry, times, units, kinds[name])
            continue
        log = _log(source, entry, columns, times, units, SENSOR_MODELS[kinds[name]], list(motions))
        # A table with rows of the truth or of several sensors does not say when this one looked and found nothing.
        logs[name] = log if entry.path is None else log._replace(scans=np.unique(times))
    said = {"file": table.file.name, "rows": len(table)}
    classes: dict[str, str] = {}
    if columns.kind is not None:
        for item, kind in zip(_names(own, columns), own.names(columns.kind, optional=True), strict=True):
            classes.setdefault(item, kind)
    return Drive(motions, order, carrier, logs, said, detections, np.unique(seconds), boxes, classes, start)


def _names(table: Rows, columns: TruthColumns) -> list[str]:
    return [OBJECT] * len(table) if columns.object is None else table.names(columns.object)


def _own(entry: MeasurementColumns, columns: TruthColumns) -> list[str | None]:
    return [entry.object or columns.object, *entry.components.values()]


def _values(table: Rows, columns: MotionColumns, units: Units, own: Mapping[str, str]) -> dict[str, Array]:
    value = {
        key: table.numbers(column, units.factor(quantity, own.get(key)), quantity)
        for key, column in columns.given.items()
        if (quantity := MOTION_QUANTITIES[key]) != "time"
    }
    if "speed" in value:
        speed, course = value.pop("speed"), value.pop("course")
        value |= {"vx": speed * np.cos(course), "vy": speed * np.sin(course)}
    return value


def _motions(
    table: Rows, columns: TruthColumns, seconds: Array, config: RecordingOptions
) -> tuple[dict[str, Motion], RowOrder]:
    value = _values(table, columns, config.units, columns.units)
    for key in ("length", "width"):
        sizes = value.get(key, np.ones(1))
        for row in np.flatnonzero((sizes <= 0) | (sizes > LARGEST_M)).tolist():
            size = f"{getattr(columns, key)} is {sizes[row]:g} m"
            raise table.error(row, f"{size}, where more than 0 and at most {LARGEST_M:g} is expected")
    names = _names(table, columns)
    ids = list(dict.fromkeys(names))
    number = {name: i for i, name in enumerate(ids)}
    owner = np.array([number[name] for name in names], dtype=np.intp)
    kept, order = row_order(seconds, owner)
    members = {name: kept[owner[kept] == i] for i, name in enumerate(ids)}
    value = {**dict.fromkeys(("vx", "vy"), np.zeros(len(table))), **value}
    motions = {
        name: moved_to_centre(Motion(seconds[own], **{key: v[own] for key, v in value.items()}), config)
        for name, own in members.items()
    }
    if columns.without_velocity:
        motions = {name: _by_displacement(motion) for name, motion in motions.items()}
    return motions, order


def _by_displacement(motion: Motion) -> Motion:
    """The motion with the velocity of its displacement."""
    return motion._replace(vx=slope(motion.px, motion.time), vy=slope(motion.py, motion.time))


def observer_motion(table: Rows, columns: ObserverColumns, seconds: Array, units: Units) -> Motion:
    kept, _ = row_order(seconds, np.zeros(len(seconds), dtype=np.intp))
    time = seconds[kept]
    value = {key: column[kept] for key, column in _values(table, columns, units, columns.units).items()}
    value["heading"] = value.pop("yaw")
    motion = Motion(time, **{**dict.fromkeys(("vx", "vy"), np.zeros(len(time))), **value})
    return _by_displacement(motion) if columns.without_velocity else motion


def _require_one_pose_a_time(table: Rows, columns: ObserverColumns, seconds: Array) -> None:
    """Make sure that the observer is in one place at a time.

    Raises:
        InputError: two rows of one time disagree.
    """
    _, first, of_row = np.unique(seconds, return_index=True, return_inverse=True)
    for column in columns.given.values():
        values = table.numbers(column, 1.0, None)
        for row in np.flatnonzero(values != values[first][of_row]).tolist():
            raise table.error(row, f"{column} differs from that of the same time in a row before")


def _log(
    table: Rows,
    entry: MeasurementColumns,
    columns: TruthColumns,
    at: Array,
    units: Units,
    sensor: type[Sensor],
    ids: list[str],
) -> Log:
    measurement, rows = column_measurements(table, entry, units, sensor)
    owner = _owners(table, entry.object or columns.object, rows, ids, blank=entry.path is not None)
    alarm = np.flatnonzero(owner < 0)
    alarm = alarm[np.argsort(at[rows[alarm]], kind="stable")]
    measured_rows, own = rows[owner >= 0], owner[owner >= 0]
    kept, order = row_order(at[measured_rows], own)
    time = at[measured_rows][kept]
    of_objects, alarms = measurement[:, owner >= 0][:, kept], measurement[:, alarm]
    order = replace(order, rows=len(rows))
    return Log(time, own[kept], of_objects, np.unique(time), order, at[rows[alarm]], alarms)


def _owners(table: Rows, column: str | None, rows: Indices, ids: list[str], *, blank: bool) -> Indices:
    """The number of the object of each of the rows; -1 where it is ``blank``, if it may be.

    Raises:
        InputError: the truth does not have it.
    """
    if column is None:
        return np.zeros(len(rows), dtype=np.intp)
    names, number = table.names(column, optional=blank), {name: i for i, name in enumerate(ids)}
    number |= {"": -1} if blank else {}
    for row in rows.tolist():
        if names[row] not in number:
            raise table.error(row, f"the truth has no object {names[row]!r}; {nearest(names[row], ids)}")
    return np.array([number[names[row]] for row in rows], dtype=np.intp)
