"""Readers of table files: CSV and Parquet."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pacsv
import pyarrow.parquet as pq

from trackbench.base.errors import InputError, nearest_choices, shortened_text
from trackbench.base.files import read_text
from trackbench.truth.config.columns import UNITS
from trackbench.truth.recorded.rows import Rows, plain_column


def log_text(file: Path) -> str:
    """Return the text of a log in UTF-8, which must not be empty.

    Raises:
        InputError: the file cannot be read, is empty or is not UTF-8.
    """
    text = read_text(file)
    if not text.strip():
        raise InputError("the file is empty", file=file)
    return text


def read_table(file: Path, form: str, wanted: Iterable[str | None]) -> Rows:
    """Return the columns ``wanted`` of a file whose format ``form`` is "csv" or "parquet".

    Raises:
        InputError: the file cannot be read or has no such column, or no row.
    """
    names = [name for name in dict.fromkeys(wanted) if name is not None]
    rows = (_csv if form == "csv" else _parquet)(file, names)
    if not len(rows):
        raise InputError("the file has no row of data", file=file)
    return rows


def read_header(file: Path, form: str) -> list[str]:
    """Return the names of the columns of a file whose format ``form`` is "csv" or "parquet".

    Raises:
        InputError: the file cannot be read, or two columns have one name.
    """
    if form == "csv":
        names = next(_csv_rows(file))[1]
    else:
        with _reading_parquet(file):
            names = list(pq.read_schema(file).names)
    _require_columns(names, names, file)
    return names


def _csv_rows(file: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and trimmed cells of the rows of a CSV file that are not blank."""
    reader = csv.reader(io.StringIO(log_text(file), newline=""), strict=True)
    try:
        yield from ((reader.line_num, cells) for row in reader if any(cells := [cell.strip() for cell in row]))
    except csv.Error as error:
        raise InputError(f"not valid CSV: {error}", file=file, line=reader.line_num) from None


def _csv(file: Path, names: list[str]) -> Rows:
    first, header = next(_csv_rows(file))
    _require_columns(names, header, file, first)
    raw, numbers = log_text(file).encode(), [str(number) for number in range(len(header))]
    if raw.count(b'"') % 2:
        raise InputError("not valid CSV: a quotation mark is not closed", file=file)
    try:
        table = pacsv.read_csv(
            pa.BufferReader(raw),
            # One thread keeps the order of rows; a row is never longer than the file.
            pacsv.ReadOptions(column_names=numbers, skip_rows=first, use_threads=False, block_size=len(raw) + 1),
            pacsv.ParseOptions(
                newlines_in_values=True, invalid_row_handler=lambda row: "error" if row.text.strip() else "skip"
            ),
            pacsv.ConvertOptions(column_types=dict.fromkeys(numbers, pa.string())),
        )
    except pa.ArrowInvalid as error:
        for line, cells in islice(_csv_rows(file), 1, None):
            if len(cells) != len(header):
                message = f"{len(cells)} columns, where the header has {len(header)}"
                raise InputError(message, file=file, line=line) from None
        raise InputError(f"no table of CSV: {str(error).splitlines()[0]}", file=file) from None
    columns = [pc.utf8_trim_whitespace(column) for column in table.columns]
    is_blank = np.logical_and.reduce([pc.equal(column, "").to_numpy() for column in columns])
    table = pa.table({name: columns[header.index(name)] for name in names}).filter(pa.array(~is_blank))
    return Rows(file, table, lambda place: next(islice(_csv_rows(file), place + 1, None))[0])


@contextmanager
def _reading_parquet(file: Path) -> Iterator[None]:
    try:
        yield
    except (pa.ArrowException, OSError, ValueError, OverflowError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"not a Parquet file that can be read: {reason}", file=file) from None


def _parquet(file: Path, names: list[str]) -> Rows:
    with _reading_parquet(file):
        _require_columns(names, pq.read_schema(file).names, file)
        table = pq.read_table(file, columns=names)
        return Rows(file, pa.table({name: plain_column(name, table[name], file) for name in names}))


def _require_columns(names: Sequence[str], header: Sequence[str], file: Path, line: int | None = None) -> None:
    for name in names:
        if name not in header:
            if len(header) == 1 and {*";\t"} & {*header[0]}:
                raise InputError(
                    "columns are separated by commas here, and in the file they are not", file=file, line=line
                )
            column, _, unit = name.rpartition(":")
            if column in header:
                units = "; ".join(", ".join(UNITS[quantity]) for quantity in ("time", "length", "speed", "angle"))
                problem = f"{unit!r} after column {column!r} is no unit of what the column has: use one of {units}"
                raise InputError(problem, file=file, line=line)
            names_there = [shortened_text(column, 40) for column in header]
            raise InputError(f"there is no column {name!r}; {nearest_choices(name, names_there)}", file=file, line=line)
        if header.count(name) > 1:
            raise InputError(f"there are {header.count(name)} columns {name!r}", file=file, line=line)
