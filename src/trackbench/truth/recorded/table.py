"""Logs in tables with columns named by the scenario: a drive, or scans without a truth."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
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
from trackbench.truth.recorded.rows import Labels, Rows
from trackbench.truth.recorded.scans import column_measurements, scans_of
from trackbench.truth.recorded.table_files import read_table

#: Name of the object in a file without names.
OBJECT = "object"


def load_tables(config: RecordingOptions, kinds: Mapping[str, str], folder: Path) -> Drive:
    """Return the motion of all objects and of the observer, and the measurements of each sensor in ``measurements``.

    The scenario names the columns; ``kinds`` is the kind of each sensor by name.

    Raises:
        InputError: a file cannot be read, or a row is damaged.
    """
    assert config.columns is not None
    assert config.path is not None
    columns = config.columns
    wanted = [_time(columns.time).name, columns.object, *_names(columns), columns.kind]
    for name, entry in config.measurements.items():
        if entry.path is None:
            wanted += _wanted(entry, columns.time, columns.object, SENSOR_MODELS[kinds[name]])
    table = read_table(find_log(config.path, folder, "truth.path"), config.format, wanted)
    clock = table.times(_time(columns.time))
    start = clock.first
    seconds = clock.since(start)
    _require_not_long(table, _time(columns.time), seconds)
    motions, order = _motions(table, columns, seconds)
    ego = config.ego
    moving = None if ego is None else _observer(ego, ego.time or columns.time, config, folder, start)
    logs: dict[str, Log] = {}
    detections: dict[str, Scans] = {}
    for name, entry in config.measurements.items():
        source, unlabelled, sensor = table, config.unlabelled(name), SENSOR_MODELS[kinds[name]]
        if entry.path is not None:
            needed = _wanted(entry, columns.time, None if unlabelled else columns.object, sensor)
            source = _detections_of_file(name, entry, needed, config, folder)
        times = source.times(_time(entry.time or columns.time)).since(start) + entry.time_offset_s
        if unlabelled:
            detections[name] = scans_of(source, entry, times, kinds[name])
            continue
        log = _log(source, entry, columns, times, sensor, list(motions))
        # A table shared with the truth or other sensors does not show empty scans of this sensor.
        logs[name] = log if entry.path is None else log._replace(scans=np.unique(times))
    classes: dict[str, str] = {}
    if columns.kind is not None:
        names, number = _objects(table, columns)
        first = np.unique(number, return_index=True)[1].tolist()
        kinds_of_rows = table.labels(columns.kind, optional=True)
        classes = {name: kinds_of_rows.names[kinds_of_rows.number[row]] for name, row in zip(names, first, strict=True)}
    read = {"file": table.file.name, "rows": len(table)}
    return Drive(motions, order, moving, logs, read, detections, np.unique(seconds), kinds=classes, start=start)


def load_unlabelled(config: RecordingOptions, kinds: Mapping[str, str], folder: Path) -> Drive:
    """Return a drive without a truth: the detections of each sensor, and the motion of the observer.

    Raises:
        InputError: a file cannot be read or is damaged; with its name, and its line or row.
    """
    tables, clocks = {}, {}
    for name, entry in config.measurements.items():
        needed = _wanted(entry, "", None, SENSOR_MODELS[kinds[name]])
        tables[name] = _detections_of_file(name, entry, needed, config, folder)
        clocks[name] = tables[name].times(_time(entry.time or ""))
    start, moving = min(clock.first for clock in clocks.values()), None
    detections = {}
    for name, entry in config.measurements.items():
        seconds = clocks[name].since(start)
        _require_not_long(tables[name], _time(entry.time or ""), seconds)
        detections[name] = scans_of(tables[name], entry, seconds + entry.time_offset_s, kinds[name])
    if config.ego is not None:
        moving = _observer(config.ego, config.ego.time or "", config, folder, start)
    return Drive({}, RowOrder(0, 0, 0.0, 0), moving, {}, {}, detections)


def _detections_of_file(
    name: str, entry: MeasurementColumns, columns: Iterable[str | None], config: RecordingOptions, folder: Path
) -> Rows:
    file = find_log(entry.path or "", folder, f"truth.readings.{name}.path")
    return read_table(file, config.format, columns)


def _require_not_long(table: Rows, time: Column, seconds: Array) -> None:
    if seconds.max() > jumps.LONGEST:
        row = int(np.argmax(seconds))
        raise table.error(row, f"{time.name}: {jumps.why_too_long(seconds[row])}")


def _objects(table: Rows, columns: TruthColumns) -> Labels:
    if columns.object is None:
        return Labels([OBJECT], np.zeros(len(table), dtype=np.intp))
    return table.labels(columns.object)


def _time(text: str) -> Column:
    return stated_column(text, "time")


def _wanted(entry: MeasurementColumns, time: str, owner: str | None, sensor: type[Sensor]) -> list[str | None]:
    """Return the names of the columns with a sensor's measurements; None for a column that is not stated.

    Args:
        entry: columns of the measurements.
        time: column of the time, unless the entry has its own.
        owner: column of the object, unless the entry has its own.
        sensor: model of the sensor.
    """
    components = entry.columns(sensor.components, sensor.units).values()
    own = _time(entry.time or time).name, entry.object or owner, entry.slot, entry.new_track
    return [*own, *(column.name for column in components)]


def _names(columns: MotionColumns) -> list[str]:
    return [column.name for column in columns.stated.values()]


def _values(table: Rows, columns: MotionColumns) -> dict[str, Array]:
    return {key: table.numbers(column) for key, column in columns.stated.items()}


def _motions(table: Rows, columns: TruthColumns, seconds: Array) -> tuple[dict[str, Motion], RowOrder]:
    value = _values(table, columns)
    ids, owner = _objects(table, columns)
    kept, order = row_order(seconds, owner)
    members = dict(zip(ids, (kept[rows] for rows in rows_of_each(owner[kept], len(ids))), strict=True))
    value = {**dict.fromkeys(("vx", "vy"), np.zeros(len(table))), **value}
    motions = {name: Motion(seconds[i], **{key: v[i] for key, v in value.items()}) for name, i in members.items()}
    if columns.without_velocity:
        motions = {name: _with_displacement_velocity(motion) for name, motion in motions.items()}
    return motions, order


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
    columns: TruthColumns,
    times: Array,
    sensor: type[Sensor],
    ids: list[str],
) -> Log:
    measurement, rows = column_measurements(table, entry, sensor)
    owner = _owners(table, entry.object or columns.object, rows, ids, blank=entry.path is not None)
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
