"""The rows of a table of a recording, as CSV or Parquet."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from decimal import Decimal
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from trackbench.base.errors import InputError, nearest_choices, shortened_text
from trackbench.base.files import read_text
from trackbench.base.numbers import stated_number
from trackbench.base.types import Array, Indices, Mask
from trackbench.truth import jumps
from trackbench.truth.recorded import mcap

if TYPE_CHECKING:
    import pyarrow as pa


def log_text(file: Path) -> str:
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
#: A time stamp of ISO 8601: whole seconds, their fraction, and the zone.
_ISO = re.compile(
    r"(\d{4}-?\d\d-?\d\d[T ]\d\d:?\d\d(?::?\d\d)?)(?:[.,](\d{1,18}))?\s?(Z|UTC|[+-]\d\d(?::?\d\d)?)?",
    re.ASCII | re.IGNORECASE,
)
#: What a time stamp may be, by whether it states its zone; None where it is a number.
_STAMPS = {None: "a number", True: "a time stamp with a zone", False: "a time stamp without a zone"}
#: Rows among which the column names of a CSV file are looked for: programs write lines about themselves first.
FIRST_ROWS = 20
#: Of times: nanoseconds since 1970 are 2e18.
LARGEST = 1e30
#: Of one file. Each takes about 700 bytes of memory.
MOST_ROWS = 10_000_000


class IsoStamp(NamedTuple):
    """A time stamp of ISO 8601."""

    seconds: Decimal
    """Since 1970, UTC."""
    has_zone: bool
    """Whether it states its zone; if not, it is taken as UTC."""


def iso_stamp(value: object) -> IsoStamp | None:
    """Return the time stamp of ISO 8601 that a cell is, in full precision; None where it is none."""
    parts = _ISO.fullmatch(value.strip()) if isinstance(value, str) else None
    if parts is None:
        return None
    whole, fraction, zone = parts.groups()
    offset = "+00:00" if (zone or "Z").upper() in ("Z", "UTC") else zone
    try:
        seconds = round(datetime.fromisoformat(whole.upper() + offset).timestamp())
    except (ValueError, OverflowError):
        return None
    return IsoStamp(seconds + Decimal(f"0.{fraction or 0}"), zone is not None)


@contextmanager
def reading_parquet(file: Path) -> Iterator[None]:
    """Raise what Parquet's reader finds wrong with a file as an ``InputError``."""
    import pyarrow as pa

    try:
        yield
    except (pa.ArrowException, OSError, ValueError, OverflowError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"not a Parquet file that can be read: {reason}", file=file) from None


class Rows(NamedTuple):
    """The columns of a table, as the file holds them."""

    file: Path
    columns: Mapping[str, Sequence[Any]]
    lines: Sequence[int] | None
    """The line of each row; None where the file has no lines."""
    places: Indices | None = None
    """Of some rows of a file, the number of each in it, from 0; None: all rows."""

    def only(self, chosen: Mask) -> Rows:
        """Some of the rows."""
        places = np.flatnonzero(chosen)
        columns = {name: [values[row] for row in places.tolist()] for name, values in self.columns.items()}
        lines = None if self.lines is None else [self.lines[row] for row in places.tolist()]
        return Rows(self.file, columns, lines, places)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def error(self, row: int, message: str) -> InputError:
        """What is wrong with a row (from 0)."""
        if self.lines is None:
            row = row if self.places is None else int(self.places[row])
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

    def times(self, column: str, factor: float) -> list[Decimal]:
        """Return a column of times in s, exactly as written.

        Args:
            column: its name.
            factor: from the unit of numbers; time stamps of ISO 8601 count from 1970.

        Raises:
            InputError: a cell is no time, or the column mixes numbers, time stamps with a zone and without.
        """
        scale, times = Decimal(str(factor)), []
        kinds: dict[bool | None, None] = {}
        for row, value in enumerate(self.columns[column]):
            stamp = iso_stamp(value)
            if stamp is None and abs(self._number(row, column, value)) > LARGEST:
                raise self.error(row, f"{column} is too large to be meant: {str(value)[:20]!r}")
            kinds[stamp and stamp.has_zone] = None
            if len(kinds) > 1:
                before, now = (_STAMPS[kind] for kind in kinds)
                raise self.error(row, f"{column} is {now}, {str(value)[:40]!r}, where the rows before have {before}")
            number = value.strip() if isinstance(value, str) else value
            times.append(scale * Decimal(number) if stamp is None else stamp.seconds)
        return times

    def zone_notes(self, column: str) -> list[str]:
        """Return the line that says of a column of times that its time stamps have no zone; empty where they have."""
        stamp = iso_stamp(self.columns[column][0])
        without = stamp is not None and not stamp.has_zone
        return [f"{self.file.name}: {column} states no zone, so it is taken as UTC"] if without else []

    def names(self, column: str, *, optional: bool = False) -> list[str]:
        """A column of names; an empty one is "", if it may be."""
        names = []
        for row, value in enumerate(self.columns[column]):
            if optional and _unknown(value):
                names.append("")
                continue
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
            number = stated_number(value.strip())
        else:
            is_number = isinstance(value, int | float | Decimal) and not isinstance(value, bool)
            number = float(value) if is_number else math.nan
        if not math.isfinite(number):
            raise self.error(row, f"{column} is not a finite number: {str(value)[:20]!r}")
        return number


def read_table(file: Path, form: str, wanted: Iterable[str | None], part: mcap.LogPart | None = None) -> Rows:
    """The columns of a file of the format "csv", "parquet" or "mcap" that are wanted; of MCAP those of a part.

    Raises:
        InputError: the file cannot be read or has no such column, or no row.
    """
    names = [name for name in dict.fromkeys(wanted) if name is not None]
    if form == "mcap":
        assert part is not None
        every = mcap.log_columns(file, part)
        _require(names, list(every), file, None)
        rows = Rows(file, {name: every[name] for name in names}, None)
    else:
        rows = _csv(file, names) if form == "csv" else _parquet(file, names)
    if not len(rows):
        raise InputError("the file has no row of data", file=file)
    return rows


def csv_rows(file: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows of a CSV file that are not blank from its column names on, each with its line.

    Lines before the column names are left out: they have another number of cells than the rows of data.

    Raises:
        InputError: the file cannot be read, or is not valid CSV.
    """
    reader = csv.reader(log_text(file).splitlines(keepends=True), strict=True)
    rows = ((reader.line_num, row) for row in reader if any(cell.strip() for cell in row))
    try:
        first = list(islice(rows, FIRST_ROWS))
        yield from chain(first[_header_place([row for _, row in first]) :], rows)
    except csv.Error as error:
        raise InputError(f"not valid CSV: {error}", file=file, line=reader.line_num) from None


def _header_place(rows: Sequence[list[str]]) -> int:
    """The first row as wide as the last if it has no number; else the first row of all."""
    place = next(number for number, row in enumerate(rows) if len(row) == len(rows[-1]))
    cells = [cell.strip() for cell in rows[place]]
    are_names = all(math.isnan(stated_number(cell)) and iso_stamp(cell) is None for cell in cells)
    return place if len(cells) > 1 and are_names else 0


def _csv(file: Path, names: list[str]) -> Rows:
    lines: list[int] = []
    rows: list[list[str]] = []
    header: list[str] = []
    for line, row in csv_rows(file):
        if not header:
            header = [name.strip() for name in row]
            _require(names, header, file, line)
            continue
        if len(row) != len(header):
            raise InputError(f"{len(row)} columns, where the header has {len(header)}", file=file, line=line)
        rows.append(row)
        lines.append(line)
        _require_few(len(rows), file)
    columns = {name: [row[header.index(name)] for row in rows] for name in names}
    return Rows(file, columns, lines)


def _parquet(file: Path, names: list[str]) -> Rows:
    import pyarrow.parquet as pq

    with reading_parquet(file):
        metadata = pq.read_metadata(file)
        schema = metadata.schema.to_arrow_schema()
        _require(names, schema.names, file, None)
        _require_plain(names, schema, file)
        _require_few(metadata.num_rows, file)
        table = pq.read_table(file, columns=names)
        columns = {name: _parquet_cells(table[name]) for name in names}
    return Rows(file, columns, None)


def _parquet_cells(column: Any) -> list[Any]:
    """The cells of a column, time stamps as text of ISO 8601: Python's own have no nanoseconds."""
    import pyarrow as pa

    if not pa.types.is_timestamp(column.type):
        cells: list[Any] = column.to_pylist()
        return cells
    zone = "" if column.type.tz is None else "Z"
    texts = np.datetime_as_string(column.to_numpy()).tolist()
    return [None if text == "NaT" else text + zone for text in texts]


def _require_plain(names: list[str], schema: pa.Schema, file: Path) -> None:
    """Make sure that columns hold single numbers, times or texts: a truth value or a list would be read as another."""
    from pyarrow import types

    for name in names:
        kind = schema.field(name).type
        value = kind.value_type if types.is_dictionary(kind) else kind
        others = types.is_boolean, types.is_nested, types.is_binary, types.is_large_binary, types.is_fixed_size_binary
        if any(is_other(value) for is_other in others):
            raise InputError(f"{name} is a column of {kind}, where numbers or texts are expected", file=file)


def _require_few(rows: int, file: Path) -> None:
    if rows > MOST_ROWS:
        raise InputError(f"more than {MOST_ROWS} rows; cut the log", file=file)


def _require(names: list[str], header: list[str], file: Path, line: int | None) -> None:
    # What is no table is not to be shown in a message.
    if not {*names} & {*header} and not all(_COLUMN.fullmatch(name) for name in header):
        raise InputError(f"this is no row of column names; expected {', '.join(names)}", file=file, line=line)
    for name in names:
        if name not in header:
            names_there = [shortened_text(column, 40) for column in header]
            raise InputError(f"there is no column {name!r}; {nearest_choices(name, names_there)}", file=file, line=line)
        if header.count(name) > 1:
            raise InputError(f"there are {header.count(name)} columns {name!r}", file=file, line=line)


def _empty(value: Any) -> bool:
    return value is None or (isinstance(value, str) and not value.strip())


def _unknown(value: Any) -> bool:
    """Empty, or "not a number": as programs write what they do not know."""
    if isinstance(value, str):
        return value.strip().lower() in ("", "nan")
    return value is None or (isinstance(value, float) and math.isnan(value))


def seconds_from(start: Decimal, stamps: list[Decimal]) -> Array:
    """To the nanosecond, below which no clock of a vehicle tells rows apart."""
    return np.array([round(float(stamp - start), 9) for stamp in stamps])
