"""A drive from tables whose columns and units the scenario names."""

from __future__ import annotations

from collections.abc import Mapping
from decimal import Decimal
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
from trackbench.truth.config.logs import find
from trackbench.truth.recorded.drive import Drive, Log, Motion, RowOrder, row_order
from trackbench.truth.recorded.rows import Rows, read

#: What the object is called where the file does not name it.
OBJECT = "object"


def load(config: RecordingOptions, kinds: Mapping[str, str], folder: Path) -> Drive:
    """The motion of all objects, and the measurements of the sensors whose columns are named.

    Raises:
        InputError: a file cannot be read, or a row of it is damaged.
    """
    assert config.columns is not None
    assert config.path is not None
    columns, units = config.columns, config.units
    observer = columns.observer
    inside = [entry for entry in config.measurements.values() if entry.path is None]
    wanted = [columns.time, columns.object, *columns.given.values(), *(c for e in inside for c in _own(e, columns))]
    wanted += list(observer.given.values()) if observer is not None and observer.path is None else []
    table = read(find(config.path, folder, "truth.path"), config.format, [name for name in wanted if name is not None])
    stamps = time_stamps(table, columns.time, units.factor("time", columns.units.get("time")))
    start = min(stamps)
    seconds = seconds_from(start, stamps)
    if seconds.max() > jumps.LONGEST:
        row = int(np.argmax(seconds))
        raise table.error(row, f"{columns.time}: {jumps.why_too_long(seconds[row])}")
    motions, order = _motions(table, columns, seconds, units)
    carrier = None
    if observer is not None and observer.path is not None:
        time = observer.time or columns.time
        own_rows = find(observer.path, folder, "truth.columns.observer.path")
        source = read(own_rows, config.format, [time, *observer.given.values()])
        times = seconds_from(start, time_stamps(source, time, units.factor("time", observer.units.get("time"))))
        carrier = observer_motion(source, observer, times, units)
    elif observer is not None:
        _require_one_pose_a_time(table, observer, seconds)
        carrier = observer_motion(table, observer, seconds, units)
    logs = {}
    for name, entry in config.measurements.items():
        source, own_file = table, entry.path is not None
        if entry.path is not None:
            file = find(entry.path, folder, f"truth.readings.{name}.path")
            source = read(file, config.format, _own(entry, columns))
        unit = entry.units.get("time", columns.units.get("time"))
        times = seconds_from(start, time_stamps(source, entry.time or columns.time, units.factor("time", unit)))
        times = times + entry.time_offset_s
        log = _log(source, entry, columns, times, units, SENSOR_MODELS[kinds[name]], list(motions))
        # A table with rows of the truth or of several sensors does not say when this one looked and found nothing.
        logs[name] = log._replace(scans=np.unique(times)) if own_file else log
    return Drive(motions, order, carrier, logs, {"file": table.file.name, "rows": len(table)})


def _own(entry: MeasurementColumns, columns: TruthColumns) -> list[str]:
    named = [entry.time or columns.time, entry.object or columns.object, *entry.components.values()]
    return [name for name in named if name is not None]


def time_stamps(table: Rows, column: str, factor: float) -> list[Decimal]:
    """A column of times in s, exactly, so that nanoseconds since 1970 keep their differences."""
    scale = Decimal(str(factor))
    return [stamp * scale for stamp in table.times(column)]


def seconds_from(start: Decimal, stamps: list[Decimal]) -> Array:
    """To the nanosecond, below which no clock of a vehicle tells rows apart."""
    return np.array([round(float(stamp - start), 9) for stamp in stamps])


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


def _motions(table: Rows, columns: TruthColumns, seconds: Array, units: Units) -> tuple[dict[str, Motion], RowOrder]:
    value = _values(table, columns, units, columns.units)
    names = [OBJECT] * len(table) if columns.object is None else table.names(columns.object)
    ids = list(dict.fromkeys(names))
    number = {name: i for i, name in enumerate(ids)}
    owner = np.array([number[name] for name in names], dtype=np.intp)
    kept, order = row_order(seconds, owner)
    members = {name: kept[owner[kept] == i] for i, name in enumerate(ids)}
    return {
        name: Motion(seconds[own], **{key: v[own] for key, v in value.items()}) for name, own in members.items()
    }, order


def observer_motion(table: Rows, columns: ObserverColumns, seconds: Array, units: Units) -> Motion:
    kept, _ = row_order(seconds, np.zeros(len(seconds), dtype=np.intp))
    time = seconds[kept]
    value = {key: column[kept] for key, column in _values(table, columns, units, columns.units).items()}
    for key, position in (("vx", "px"), ("vy", "py")):
        if key not in value:
            value[key] = np.gradient(value[position], time) if len(time) > 1 else np.zeros(1)
    return Motion(time, value["px"], value["py"], value["vx"], value["vy"], value["yaw"], value.get("yaw_rate"))


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
    measurement, detected = measured(table, entry, units, sensor)
    owner = _owners(table, entry.object or columns.object, detected, ids)
    kept, order = row_order(at[detected], owner)
    time = at[detected][kept]
    return Log(time, owner[kept], measurement[:, kept], np.unique(time), order)


def measured(table: Rows, entry: MeasurementColumns, units: Units, sensor: type[Sensor]) -> tuple[Array, Indices]:
    """The measurements ``(m, n)`` in SI units and radians, and the rows ``(n,)`` that have one.

    Raises:
        InputError: a number is damaged, or no row has a measurement.
    """
    named, quantities = entry.components, entry.quantities(sensor.components, sensor.units)
    values = []
    for name, quantity in quantities.items():
        factor = units.factor(quantity, entry.units.get(name))
        bias = entry.bias.get(name, 0.0) * factor
        values.append(table.numbers(named[name], factor, quantity, optional=True) - bias)
    there = np.isfinite(values)
    for row in np.flatnonzero(there.any(axis=0) & ~there.all(axis=0)).tolist():
        missing = named[list(quantities)[int(np.argmin(there[:, row]))]]
        raise table.error(row, f"{missing} is empty, but other columns of the same measurement are not")
    rows = np.flatnonzero(there.all(axis=0))
    if not len(rows):
        raise InputError(f"there is no measurement in {', '.join(named.values())}", file=table.file)
    measurement = np.stack(values)[:, rows]
    if tuple(quantities) != sensor.components:
        x, y = measurement[:2]
        measurement = np.stack([np.hypot(x, y), np.arctan2(y, x), *measurement[2:]])
    return measurement, rows


def _owners(table: Rows, column: str | None, rows: Indices, ids: list[str]) -> Indices:
    """The number of the object of each of the rows.

    Raises:
        InputError: the truth does not have it.
    """
    if column is None:
        return np.zeros(len(rows), dtype=np.intp)
    names, number = table.names(column), {name: i for i, name in enumerate(ids)}
    for row in rows.tolist():
        if names[row] not in number:
            raise table.error(row, f"the truth has no object {names[row]!r}; {nearest(names[row], ids)}")
    return np.array([number[names[row]] for row in rows], dtype=np.intp)
