"""Logs in tables with columns named by the scenario: a drive, or scans without a truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np

from trackbench.base.errors import nearest_choices
from trackbench.base.types import Array, Indices
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.truth import jumps
from trackbench.truth.config.columns import (
    Column,
    MeasurementColumns,
    MotionColumns,
    ObserverColumns,
    TruthColumns,
    stated_column,
)
from trackbench.truth.config.logs import find_log
from trackbench.truth.config.recording import RecordingOptions
from trackbench.truth.recorded.drive import (
    Drive,
    Log,
    Motion,
    RowOrder,
    Scans,
    row_order,
    rows_of_each,
    slope,
)
from trackbench.truth.recorded.rows import Rows
from trackbench.truth.recorded.scans import column_measurements, scans_of
from trackbench.truth.recorded.table_files import read_table

#: Name of the object in a file without names.
OBJECT = "object"


def load_tables(config: RecordingOptions, kinds: Mapping[str, str], folder: Path) -> Drive:
    """Return the motion of all objects, if there is a truth, and of the observer, and each sensor's measurements.

    The scenario names the columns; ``kinds`` is the kind of each sensor by name.

    Raises:
        InputError: a file cannot be read or is damaged; with its name, and its line or row.
    """
    columns, drive = config.columns, Drive({}, RowOrder(0, 0, 0.0, 0), None, {}, {})
    time, owner = ("", None) if columns is None else (columns.time, columns.object)
    wanted: dict[str, list[str | None]] = {}
    for name, entry in config.measurements.items():
        needs_owner = not config.unlabelled(name)
        wanted[name] = _wanted(entry, time, owner if needs_owner else None, SENSOR_MODELS[kinds[name]])
    tables: dict[str, Rows] = {}
    if columns is not None:
        shared = [column for name in wanted if config.measurements[name].path is None for column in wanted[name]]
        shared += [_time(time).name, owner, *_names(columns), columns.kind]
        table = read_table(find_log(config.path or "", folder, "truth.path"), config.format, shared)
        drive, tables = _truth(table, columns), dict.fromkeys(wanted, table)
    for name, entry in config.measurements.items():
        if entry.path is not None:
            file = find_log(entry.path, folder, f"truth.readings.{name}.path")
            tables[name] = read_table(file, config.format, wanted[name])
    clocks = {name: tables[name].times(_time(entry.time or time)) for name, entry in config.measurements.items()}
    start = min(clock.first for clock in clocks.values()) if columns is None else drive.start
    ego = config.ego
    moving = None if ego is None else _observer(ego, ego.time or time, config, folder, start)
    logs: dict[str, Log] = {}
    detections: dict[str, Scans] = {}
    for name, entry in config.measurements.items():
        table, seconds = tables[name], clocks[name].since(start)
        _require_not_long(table, _time(entry.time or time), seconds)
        times = seconds + entry.time_offset_s
        if config.unlabelled(name):
            detections[name] = scans_of(table, entry, times, kinds[name])
            continue
        log = _log(table, entry, owner, times, SENSOR_MODELS[kinds[name]], list(drive.motions))
        # A table shared with the truth or other sensors does not show empty scans of this sensor.
        logs[name] = log if entry.path is None else log._replace(scans=np.unique(times))
    return replace(drive, observer=moving, logs=logs, detections=detections)


def _truth(table: Rows, columns: TruthColumns) -> Drive:
    clock = table.times(_time(columns.time))
    seconds = clock.since(clock.first)
    _require_not_long(table, _time(columns.time), seconds)
    value = _values(table, columns)
    ids, owner = [OBJECT], np.zeros(len(table), dtype=np.intp)
    if columns.object is not None:
        ids, owner = table.labels(columns.object)
    kept, order = row_order(seconds, owner)
    members = dict(zip(ids, (kept[rows] for rows in rows_of_each(owner[kept], len(ids))), strict=True))
    value = {**dict.fromkeys(("vx", "vy"), np.zeros(len(table))), **value}
    motions = {name: Motion(seconds[i], **{key: v[i] for key, v in value.items()}) for name, i in members.items()}
    if columns.without_velocity:
        motions = {name: _with_displacement_velocity(motion) for name, motion in motions.items()}
    kinds: dict[str, str] = {}
    if columns.kind is not None:
        kind, first = table.labels(columns.kind, optional=True).of_rows, np.unique(owner, return_index=True)[1]
        kinds = {name: kind[row] for name, row in zip(ids, first.tolist(), strict=True)}
    read = {"file": table.file.name, "rows": len(table)}
    return Drive(motions, order, None, {}, read, frames=np.unique(seconds), kinds=kinds, start=clock.first)


def _require_not_long(table: Rows, time: Column, seconds: Array) -> None:
    if seconds.max() > jumps.LONGEST:
        row = int(np.argmax(seconds))
        raise table.error(row, f"{time.name}: {jumps.why_too_long(seconds[row])}")


def _time(text: str) -> Column:
    return stated_column(text, "time")


def _wanted(entry: MeasurementColumns, time: str, owner: str | None, sensor: type[Sensor]) -> list[str | None]:
    """Return the names of the columns with a sensor's measurements; None for a column that is not stated.

    Args:
        entry: columns of the measurements.
        time: column of the time, unless ``entry`` names another.
        owner: column of the object, unless ``entry`` names another.
        sensor: model of the sensor.
    """
    components = entry.columns(sensor.components, sensor.units).values()
    own = _time(entry.time or time).name, entry.object or owner, entry.slot, entry.new_track
    return [*own, *(column.name for column in components)]


def _names(columns: MotionColumns) -> list[str]:
    return [column.name for column in columns.stated.values()]


def _values(table: Rows, columns: MotionColumns) -> dict[str, Array]:
    value = {key: table.numbers(column) for key, column in columns.stated.items()}
    if "speed" in value:
        speed, course = value.pop("speed"), value.pop("course")
        value |= {"vx": speed * np.cos(course), "vy": speed * np.sin(course)}
    return value


def _with_displacement_velocity(motion: Motion) -> Motion:
    return motion._replace(vx=slope(motion.px, motion.time), vy=slope(motion.py, motion.time))


def _observer(
    columns: ObserverColumns, time_column: str, config: RecordingOptions, folder: Path, start: Decimal
) -> Motion:
    file, clock = find_log(columns.path, folder, "truth.ego.path"), _time(time_column)
    table = read_table(file, config.format, [clock.name, *_names(columns)])
    seconds = table.times(clock).since(start)
    rows, _ = row_order(seconds, np.zeros(len(seconds), dtype=np.intp))
    time = seconds[rows]
    value = {key: column[rows] for key, column in _values(table, columns).items()}
    value["heading"] = value.pop("yaw")
    motion = Motion(time, **{**dict.fromkeys(("vx", "vy"), np.zeros(len(time))), **value})
    return _with_displacement_velocity(motion) if columns.without_velocity else motion


def _log(
    table: Rows,
    entry: MeasurementColumns,
    owner_column: str | None,
    times: Array,
    sensor: type[Sensor],
    ids: list[str],
) -> Log:
    measurement, rows = column_measurements(table, entry, sensor)
    owner = _owners(table, entry.object or owner_column, rows, ids, blank=entry.path is not None)
    alarm = np.flatnonzero(owner < 0)
    alarm = alarm[np.argsort(times[rows[alarm]], kind="stable")]
    measured_rows, owners = rows[owner >= 0], owner[owner >= 0]
    kept, order = row_order(times[measured_rows], owners)
    time = times[measured_rows][kept]
    of_objects, alarms = measurement[:, owner >= 0][:, kept], measurement[:, alarm]
    order = replace(order, rows=len(rows))
    return Log(time, owners[kept], of_objects, np.unique(time), order, times[rows[alarm]], alarms)


def _owners(table: Rows, column: str | None, rows: Indices, ids: list[str], *, blank: bool) -> Indices:
    """Return the index in ``ids`` of each row's object; -1 for an empty name, if ``blank`` allows it."""
    if column is None:
        return np.zeros(len(rows), dtype=np.intp)
    labels, number = table.labels(column, optional=blank), {name: i for i, name in enumerate(ids)}
    number |= {"": -1} if blank else {}
    owner = np.array([number.get(name, len(ids)) for name in labels.names], dtype=np.intp)[labels.number[rows]]
    if (is_unknown := owner == len(ids)).any():
        row = int(rows[np.argmax(is_unknown)])
        name = labels.names[labels.number[row]]
        raise table.error(row, f"the truth has no object {name!r}; {nearest_choices(name, ids)}")
    return owner
