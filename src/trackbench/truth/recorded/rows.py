"""A table read from a file, and its columns as numbers, times or names."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_FLOOR, Decimal
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import types

from trackbench.base.errors import InputError
from trackbench.base.numbers import stated_number
from trackbench.base.types import Array, Indices, Mask
from trackbench.truth import jumps
from trackbench.truth.config.columns import Column

#: Start of a time stamp of ISO 8601.
STAMP = r"^\d{4}-?\d\d-?\d\d[Tt ]\d\d"
PER_SECOND = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
#: Largest time that counts from 0 s, as a program's own clock; larger times count from the first whole second.
FROM_ZERO_S = 1e7


class TimeColumn(NamedTuple):
    """Times in a column, exact to nanoseconds however far the clock's zero is."""

    seconds: Array
    """``(rows,)`` time of each row, s after ``start``."""
    start: Decimal = Decimal(0)
    """Clock reading, whole s, from which ``seconds`` count; ISO 8601 is from 1970 (UTC unless a zone is stated)."""

    @property
    def first(self) -> Decimal:
        """Earliest time in the column, as a reading of the file's clock, s."""
        return self.start + Decimal(repr(float(self.seconds.min())))

    def since(self, first: Decimal) -> Array:
        """Return the times of the rows since ``first``, a reading of the same clock, ``(rows,)`` s.

        The result is rounded to nanoseconds, which no clock of a vehicle resolves.
        """
        return np.asarray(np.round(self.seconds + float(self.start - first), 9))


class Labels(NamedTuple):
    """Column of names in a table: its distinct names, and for each row the index of its name."""

    names: list[str]
    """Distinct names, in the order of their first rows."""
    number: Indices
    """``(rows,)`` index of each row's name in ``names``."""

    @property
    def of_rows(self) -> list[str]:
        """``(rows,)`` name of each row."""
        return [self.names[number] for number in self.number.tolist()]


@dataclass(frozen=True)
class Rows:
    """Table read from a file, with columns of numbers, time stamps and trimmed texts ("" for an empty cell)."""

    file: Path
    table: pa.Table
    line: Callable[[int], int] | None = None
    """Function from a row's index in the file to its line; None for a file without lines."""
    places: Indices | None = None
    """``(rows,)`` index of each row in the file; None if no row of the file has been left out."""

    def __len__(self) -> int:
        return int(self.table.num_rows)

    def only(self, chosen: Mask) -> Rows:
        """Return the rows for which the mask is True."""
        return replace(self, table=self.table.filter(pa.array(chosen)), places=np.flatnonzero(chosen))

    def error(self, row: int, message: str) -> InputError:
        """Return an error that names the file and the place of a row, whose index counts from 0."""
        place = row if self.places is None else int(self.places[row])
        if self.line is None:
            return InputError(f"row {place + 1}: {message}", file=self.file)
        return InputError(message, file=self.file, line=self.line(place))

    def cell(self, row: int, column: str) -> str:
        """Return a cell as text for a message, shortened if it is long."""
        return repr(str(self.table[column][row])[:40])

    def numbers(self, column: Column, *, optional: bool = False) -> Array:
        """Return a column of finite numbers in SI units and radians, ``(rows,)``; NaN for an allowed empty cell.

        Args:
            column: column to read; the plausible limits of its quantity apply.
            optional: whether cells may be empty or nan.

        Raises:
            InputError: a cell is no number, or is implausible.
        """
        name = column.name
        values = self._floats(name)
        is_wrong = ~np.isfinite(values)
        if optional and is_wrong.any():
            is_wrong &= ~self._unknown(name)
        if is_wrong.any():
            raise self._no_number(int(np.argmax(is_wrong)), name)
        values = values * column.factor
        if column.quantity is not None:
            least, most, unit = jumps.POSSIBLE[column.quantity]
            if (is_wrong := (values < least) | (values > most)).any():
                row = int(np.argmax(is_wrong))
                problem = f"it would be {values[row]:.3g}{unit}, and {least:g} to {most:g}{unit} can be meant"
                raise self.error(row, f"{name} is {self.cell(row, name)}: {problem}: check its unit")
        return values

    def times(self, time: Column) -> TimeColumn:
        """Return a column of times.

        Raises:
            InputError: a cell is no time.
        """
        column, per_second = time.name, round(1 / time.factor)
        cells = self.table[column]
        if types.is_timestamp(cells.type):
            if cells.null_count:
                raise self._no_number(int(np.argmax(cells.is_null().to_numpy())), column)
            return _exact_times(cells.cast(pa.int64()).to_numpy(), PER_SECOND[cells.type.unit])
        if _is_text(cells.type) and re.match(STAMP, cells[0].as_py()):
            return self._time_stamps(column)
        values = self.numbers(Column(column, "time")) / per_second
        if np.abs(values).max() <= FROM_ZERO_S:
            return TimeColumn(values)
        try:
            return _exact_times(cells.cast(pa.int64()).to_numpy(), per_second)
        except pa.ArrowInvalid:
            exact = [Decimal(cell) / per_second for cell in cells.to_pylist()]
            start = min(exact).to_integral_value(ROUND_FLOOR)
            return TimeColumn(np.array([float(time - start) for time in exact]), start)

    def texts(self, column: str) -> list[str]:
        """Return the cells of a column as texts ``(rows,)``."""
        texts: list[str] = self._as_text(column).to_pylist()
        return texts

    def labels(self, column: str, *, optional: bool = False) -> Labels:
        """Return a column of names, each distinct name stored once.

        Args:
            column: name of the column.
            optional: whether cells may be empty or nan; their name is "".

        Raises:
            InputError: a name is missing, or has an unprintable character.
        """
        coded = self._as_text(column).combine_chunks().dictionary_encode()
        names: list[str] = coded.dictionary.to_pylist()
        number = np.asarray(coded.indices.to_numpy(), dtype=np.intp)
        for index, name in enumerate(names):
            if optional and name.lower() == "nan":
                names[index] = ""
            elif not (name or optional) or not name.isprintable():
                cell = f"{column} is {repr(name[:40]) if name else 'empty'}"
                raise self.error(int(np.argmax(number == index)), f"{cell}, where the name of an object is expected")
        return Labels(names, number)

    def _as_text(self, column: str) -> pa.ChunkedArray:
        cells = self.table[column]
        return cells if _is_text(cells.type) else cells.cast(pa.string()).fill_null("")

    def _floats(self, column: str) -> Array:
        """Return a column as numbers, ``(rows,)``; NaN for a cell that is no number."""
        cells = self.table[column]
        if types.is_timestamp(cells.type):
            return np.full(len(cells), np.nan)
        if not _is_text(cells.type):
            return np.asarray(cells.cast(pa.float64(), safe=False).to_numpy())
        try:
            return np.asarray(pc.if_else(pc.equal(cells, ""), None, cells).cast(pa.float64()).to_numpy())
        except pa.ArrowInvalid:
            return np.array([stated_number(cell) for cell in cells.to_pylist()])

    def _unknown(self, column: str) -> Mask:
        """Return a mask ``(rows,)`` of the cells that are empty or "nan", as programs write unknown values."""
        unknown = pc.is_in(pc.utf8_lower(self._as_text(column)), pa.array(["", "nan"]))
        return np.asarray(unknown.to_numpy(), dtype=bool)

    def _no_number(self, row: int, column: str) -> InputError:
        return self.error(row, f"{column} is not a finite number: {self.cell(row, column)}")

    def _time_stamps(self, column: str) -> TimeColumn:
        import pandas as pd

        texts = pc.replace_substring_regex(pc.utf8_upper(self.table[column]), r"\s?UTC$", "Z").to_pandas()
        times = pd.to_datetime(texts, format="ISO8601", utc=True, errors="coerce")
        if times.isna().any():
            row = int(np.argmax(times.isna()))
            raise self.error(row, f"{column} is no time of ISO 8601: {self.cell(row, column)}")
        return _exact_times(times.astype("int64").to_numpy(), PER_SECOND[times.dt.unit])


def _exact_times(stamps: Indices, per_second: int) -> TimeColumn:
    start = int(stamps.min()) // per_second
    return TimeColumn((stamps - start * per_second) / per_second, Decimal(start))


def _is_text(kind: pa.DataType) -> bool:
    return bool(types.is_string(kind))


def rows_of_columns(file: Path, columns: Mapping[str, Sequence[Any]], lines: Sequence[int] | None = None) -> Rows:
    """Return columns of numbers and texts as a table; None in a column is an empty cell.

    Args:
        file: file, for error messages.
        columns: values of each column, by its name.
        lines: line of each row in the file; None for a file without lines.
    """

    def column(values: Sequence[Any]) -> pa.Array:
        if not any(isinstance(value, bool | str | Decimal) for value in values):
            try:
                return pa.array(values)
            except (pa.ArrowException, OverflowError, ValueError, TypeError):
                pass
        texts = (None if value is None else str(value).encode(errors="replace").decode() for value in values)
        return pa.array(texts, pa.string())

    table = pa.table({name: plain_column(name, column(values), file) for name, values in columns.items()})
    return Rows(file, table, None if lines is None else lines.__getitem__)


def plain_column(name: str, column: pa.Array | pa.ChunkedArray, file: Path) -> pa.Array | pa.ChunkedArray:
    """Return a column of numbers or time stamps unchanged, of texts trimmed; refuse types that would be misread."""
    if types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    kind = column.type
    if types.is_integer(kind) or types.is_floating(kind) or types.is_timestamp(kind):
        return column
    unsupported = types.is_boolean, types.is_nested, types.is_binary, types.is_large_binary, types.is_fixed_size_binary
    if types.is_duration(kind) or any(is_other(kind) for is_other in unsupported):
        raise InputError(f"{name} is a column of {kind}, where numbers or texts are expected", file=file)
    return pc.utf8_trim_whitespace(column.cast(pa.string()).fill_null(""))
