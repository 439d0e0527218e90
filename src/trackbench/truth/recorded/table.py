"""A drive from tables whose columns and units the scenario names: their rows, and what they say."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.errors import InputError, nearest
from trackbench.base.files import read_text
from trackbench.base.types import Array, Indices
from trackbench.models.sensors import SENSOR_MODELS, Sensor
from trackbench.truth import jumps
from trackbench.truth.config import RecordingOptions
from trackbench.truth.config.logs import find
from trackbench.truth.config.recording import (
    MOTION_QUANTITIES,
    MeasurementColumns,
    MotionColumns,
    ObserverColumns,
    TruthColumns,
    Units,
)
from trackbench.truth.recorded.drive import Drive, Log, Motion, RowOrder, row_order


def text_of(file: Path) -> str:
    """The text of a file in UTF-8.

    Raises:
        InputError: it cannot be read, is empty or is not UTF-8.
    """
    text = read_text(file)
    if not text.strip():
        raise InputError("the file is empty", file=file)
    return text


#: A name as columns have it.
_COLUMN = re.compile(r"[\w .()\[\]/%°²#-]{0,64}")
NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
#: Of times: nanoseconds since 1970 are 2e18.
LARGEST = 1e30
#: Of one file. Each takes about 700 bytes of memory.
MOST_ROWS = 10_000_000


class Rows(NamedTuple):
    """The columns of a table, as the file holds them."""

    file: Path
    columns: Mapping[str, Sequence[Any]]
    lines: Sequence[int] | None
    """The line of each row; None where the file has no lines."""

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def error(self, row: int, message: str) -> InputError:
        """What is wrong with a row (from 0)."""
        if self.lines is None:
            return InputError(f"row {row + 1}: {message}", file=self.file)
        return InputError(message, file=self.file, line=self.lines[row])

    def numbers(self, column: str, factor: float, quantity: str | None, *, optional: bool = False) -> Array:
        """A column of finite numbers in SI units and radians; NaN where it is empty or says so, if it may be.

        Args:
            column: its name.
            factor: from its unit.
            quantity: a key of ``jumps.LARGEST``.
            optional: whether it may be empty.
        """
        values = np.empty(len(self))
        for row, value in enumerate(self.columns[column]):
            values[row] = math.nan if optional and _unknown(value) else self._number(row, column, value) * factor
            problem = jumps.why_too_large(values[row], quantity)
            if problem is not None:
                raise self.error(row, f"{column} is {str(value)[:20]!r}: {problem}")
        return values

    def times(self, column: str) -> list[Decimal]:
        """A column of times, exactly as written."""
        times = []
        for row, value in enumerate(self.columns[column]):
            if abs(self._number(row, column, value)) > LARGEST:
                raise self.error(row, f"{column} is too large to be meant: {str(value)[:20]!r}")
            times.append(Decimal(value.strip() if isinstance(value, str) else value))
        return times

    def names(self, column: str) -> list[str]:
        """A column of names, none of them empty."""
        names = []
        for row, value in enumerate(self.columns[column]):
            if _empty(value):
                raise self.error(row, f"{column} is empty, where the name of an object is expected")
            names.append(str(value).strip())
            problem = jumps.why_no_name(names[-1])
            if problem is not None:
                raise self.error(row, f"{column}: {problem}")
        return names

    def _number(self, row: int, column: str, value: Any) -> float:
        if _empty(value):
            raise self.error(row, f"{column} is empty, where a number is expected")
        if isinstance(value, str):
            number = float(value.strip()) if NUMBER.fullmatch(value.strip()) else math.nan
        else:
            number = float(value) if isinstance(value, int | float | Decimal) else math.nan
        if not math.isfinite(number):
            raise self.error(row, f"{column} is not a finite number: {str(value)[:20]!r}")
        return number


def read(file: Path, form: str, wanted: Iterable[str], optional: Iterable[str] = ()) -> Rows:
    """The columns of a file of the format "csv" or "parquet" that are wanted, and of the optional ones those it has.

    Raises:
        InputError: the file cannot be read or has no such column, or no row.
    """
    names = list(dict.fromkeys(wanted))
    more = [name for name in dict.fromkeys(optional) if name not in names]
    rows = _csv(file, names, more) if form == "csv" else _parquet(file, names, more)
    if not len(rows):
        raise InputError("the file has no row of data", file=file)
    return rows


def _csv(file: Path, names: list[str], optional: list[str]) -> Rows:
    reader = csv.reader(text_of(file).splitlines(keepends=True), strict=True)
    lines: list[int] = []
    rows: list[list[str]] = []
    header: list[str] = []
    try:
        for row in reader:
            if not any(cell.strip() for cell in row):
                continue
            if not header:
                header = [name.strip() for name in row]
                names = names + [name for name in optional if name in header]
                _require(names, header, file, reader.line_num)
                continue
            if len(row) != len(header):
                message = f"{len(row)} columns, where the header has {len(header)}"
                raise InputError(message, file=file, line=reader.line_num)
            rows.append(row)
            lines.append(reader.line_num)
            _require_few(len(rows), file)
    except csv.Error as error:
        raise InputError(f"not valid CSV: {error}", file=file, line=reader.line_num) from None
    columns = {name: [row[header.index(name)] for row in rows] for name in names}
    return Rows(file, columns, lines)


def _parquet(file: Path, names: list[str], optional: list[str]) -> Rows:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        metadata = pq.read_metadata(file)
        header = metadata.schema.to_arrow_schema().names
        names = names + [name for name in optional if name in header]
        _require(names, header, file, None)
        _require_few(metadata.num_rows, file)
        table = pq.read_table(file, columns=names)
        columns = {name: table[name].to_pylist() for name in names}
    except (pa.ArrowException, OSError, ValueError, OverflowError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"not a Parquet file that can be read: {reason}", file=file) from None
    return Rows(file, columns, None)


def _require_few(rows: int, file: Path) -> None:
    if rows > MOST_ROWS:
        raise InputError(f"more than {MOST_ROWS} rows; cut the log", file=file)


def _require(names: list[str], header: list[str], file: Path, line: int | None) -> None:
    # What is no table is not to be shown in a message.
    if not {*names} & {*header} and not all(_COLUMN.fullmatch(name) for name in header):
        raise InputError(f"this is no row of column names; expected {', '.join(names)}", file=file, line=line)
    for name in names:
        if name not in header:
            raise InputError(f"there is no column {name!r}; {nearest(name, header)}", file=file, line=line)
        if header.count(name) > 1:
            raise InputError(f"there are {header.count(name)} columns {name!r}", file=file, line=line)


def _empty(value: Any) -> bool:
    return value is None or (isinstance(value, str) and not value.strip())


def _unknown(value: Any) -> bool:
    """Empty, or "not a number": as programs write what they do not know."""
    if isinstance(value, str):
        return value.strip().lower() in ("", "nan")
    return value is None or (isinstance(value, float) and math.isnan(value))


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
