"""Logs in tables with columns and units named by the scenario: a drive, or scans without a truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np

from trackbench.base.errors import nearest_choices
from trackbench.base.types import Array, Indices
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.truth import jumps
from trackbench.truth.config.columns import (
    MOTION_QUANTITIES,
    MeasurementColumns,
    MotionColumns,
    ObserverColumns,
    TruthColumns,
    Units,
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
from trackbench.truth.recorded.scans import (
    column_measurements,
    columns_of,
    scans_of,
)
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
    columns, units = config.columns, config.units
    inside = [entry for entry in config.measurements.values() if entry.path is None]
    wanted = [columns.time, columns.object, *columns.stated.values()]
    wanted += [column for entry in inside for column in (entry.time, *_measurement_columns(entry, columns))]
    wanted.append(columns.kind)
    file = find_log(config.path, folder, "truth.path")
    table = read_table(file, config.format, wanted)
    clock = table.times(columns.time, units.factor("time", columns.units.get("time")))
    start = clock.first
    seconds = clock.since(start)
    _require_not_long(table, columns.time, seconds)
    motions, order = _motions(table, columns, seconds, config)
    ego = config.ego
    moving = None if ego is None else _observer(ego, ego.time or columns.time, config, folder, start)
    logs: dict[str, Log] = {}
    detections: dict[str, Scans] = {}
    for name, entry in config.measurements.items():
        source, unlabelled = table, config.unlabelled(name)
        if entry.path is not None:
            needed = columns_of(entry) if unlabelled else _measurement_columns(entry, columns)
            source = _detections_of_file(name, entry, [entry.time or columns.time, *needed], config, folder)
        unit = entry.units.get("time", columns.units.get("time"))
        measured = source.times(entry.time or columns.time, units.factor("time", unit))
        times = measured.since(start) + entry.time_offset_s
        if unlabelled:
            detections[name] = scans_of(source, entry, times, units, kinds[name])
            continue
        log = _log(source, entry, columns, times, units, SENSOR_MODELS[kinds[name]], list(motions))
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
        tables[name] = _detections_of_file(name, entry, columns_of(entry), config, folder)
        clocks[name] = tables[name].times(entry.time or "", config.units.factor("time", entry.units.get("time")))
    start, moving = min(clock.first for clock in clocks.values()), None
    detections = {}
    for name, entry in config.measurements.items():
        seconds = clocks[name].since(start)
        _require_not_long(tables[name], entry.time or "", seconds)
        detections[name] = scans_of(tables[name], entry, seconds + entry.time_offset_s, config.units, kinds[name])
    if config.ego is not None:
        moving = _observer(config.ego, config.ego.time or "", config, folder, start)
    return Drive({}, RowOrder(0, 0, 0.0, 0), moving, {}, {}, detections)


def _detections_of_file(
    name: str, entry: MeasurementColumns, columns: Sequence[str | None], config: RecordingOptions, folder: Path
) -> Rows:
    file = find_log(entry.path or "", folder, f"truth.readings.{name}.path")
    return read_table(file, config.format, columns)


def _require_not_long(table: Rows, column: str, seconds: Array) -> None:
    if seconds.max() > jumps.LONGEST:
        row = int(np.argmax(seconds))
        raise table.error(row, f"{column}: {jumps.why_too_long(seconds[row])}")


def _objects(table: Rows, columns: TruthColumns) -> Labels:
    if columns.object is None:
        return Labels([OBJECT], np.zeros(len(table), dtype=np.intp))
    return table.labels(columns.object)


def _measurement_columns(entry: MeasurementColumns, columns: TruthColumns) -> list[str | None]:
    return [entry.object or columns.object, *entry.components.values()]


def _values(table: Rows, columns: MotionColumns, units: Units, units_of_columns: Mapping[str, str]) -> dict[str, Array]:
    return {
        key: table.numbers(column, units.factor(quantity, units_of_columns.get(key)), quantity)
        for key, column in columns.stated.items()
        if (quantity := MOTION_QUANTITIES[key]) != "time"
    }


def _motions(
    table: Rows, columns: TruthColumns, seconds: Array, config: RecordingOptions
) -> tuple[dict[str, Motion], RowOrder]:
    value = _values(table, columns, config.units, columns.units)
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
    file, units = find_log(columns.path, folder, "truth.ego.path"), config.units
    table = read_table(file, config.format, [time_column, *columns.stated.values()])
    seconds = table.times(time_column, units.factor("time", columns.units.get("time"))).since(start)
    rows, _ = row_order(seconds, np.zeros(len(seconds), dtype=np.intp))
    time = seconds[rows]
    value = {key: column[rows] for key, column in _values(table, columns, units, columns.units).items()}
    value["heading"] = value.pop("yaw")
    motion = Motion(time, **{**dict.fromkeys(("vx", "vy"), np.zeros(len(time))), **value})
    return _with_displacement_velocity(motion) if columns.without_velocity else motion


def _log(
    table: Rows,
    entry: MeasurementColumns,
    columns: TruthColumns,
    times: Array,
    units: Units,
    sensor: type[Sensor],
    ids: list[str],
) -> Log:
    measurement, rows = column_measurements(table, entry, units, sensor)
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
