"""Tables of files: CSV and Parquet, from the column names on."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain, islice
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pacsv
import pyarrow.parquet as pq

from trackbench.base.errors import InputError, nearest_choices, shortened_text
from trackbench.base.files import read_text
from trackbench.base.numbers import stated_number
from trackbench.truth.recorded.rows import STAMP, Rows, plain_column, with_rows

#: Rows among which the column names of a CSV file are looked for: programs write lines about themselves first.
FIRST_ROWS = 20
#: A name as columns have it.
_COLUMN = re.compile(r"[\w .()\[\]/%°²#-]{0,64}")


def log_text(file: Path) -> str:
    """Return the text of a file in UTF-8.

    Raises:
        InputError: it cannot be read, is empty or is not UTF-8.
    """
    text = read_text(file)
    if not text.strip():
        raise InputError("the file is empty", file=file)
    return text


def read_table(file: Path, form: str, wanted: Iterable[str | None]) -> Rows:
    """Return the columns of a file of the format "csv" or "parquet" that are wanted.

    Raises:
        InputError: the file cannot be read or has no such column, or no row.
    """
    names = [name for name in dict.fromkeys(wanted) if name is not None]
    return with_rows((_csv if form == "csv" else _parquet)(file, names))


def read_header(file: Path, form: str) -> list[str]:
    """Return the names of the columns of a file of the format "csv" or "parquet".

    Raises:
        InputError: it cannot be read.
    """
    if form == "csv":
        line, names = next(csv_rows(file))
        if len(names) == 1 and (other := re.search(r"[;\t|]", names[0])):
            raise InputError(f"columns are separated by {other[0]!r}; separate them by commas", file=file, line=line)
    else:
        with reading_parquet(file):
            names = list(pq.read_schema(file).names)
    require_columns([], names, file, None)
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"there are {names.count(name)} columns {name!r}", file=file)
    return names


def csv_rows(file: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows of a CSV file that are not blank from its column names on, each with its line, cells trimmed.

    Lines before the column names are left out: they have another number of cells than the rows of data.

    Raises:
        InputError: the file cannot be read, or is not valid CSV.
    """
    reader = csv.reader(io.StringIO(log_text(file), newline=""), strict=True)
    rows = ((reader.line_num, cells) for row in reader if any(cells := [cell.strip() for cell in row]))
    try:
        first = list(islice(rows, FIRST_ROWS))
        yield from chain(first[_header_place([row for _, row in first]) :], rows)
    except csv.Error as error:
        raise InputError(f"not valid CSV: {error}", file=file, line=reader.line_num) from None


def _header_place(rows: Sequence[list[str]]) -> int:
    """The first row as wide as the last if it has no number; else the first row of all."""
    place = next(number for number, row in enumerate(rows) if len(row) == len(rows[-1]))
    are_names = all(math.isnan(stated_number(cell)) and not re.match(STAMP, cell) for cell in rows[place])
    return place if len(rows[place]) > 1 and are_names else 0


def _csv(file: Path, names: list[str]) -> Rows:
    first, header = next(csv_rows(file))
    require_columns(names, header, file, first)
    raw, numbers = log_text(file).encode(), [str(number) for number in range(len(header))]
    try:
        table = pacsv.read_csv(
            pa.BufferReader(raw),
            # In one thread rows stand in their order; a row is never longer than the file.
            pacsv.ReadOptions(column_names=numbers, skip_rows=first, use_threads=False, block_size=len(raw) + 1),
            pacsv.ParseOptions(
                newlines_in_values=True, invalid_row_handler=lambda row: "error" if row.text.strip() else "skip"
            ),
            pacsv.ConvertOptions(column_types=dict.fromkeys(numbers, pa.string())),
        )
    except pa.ArrowInvalid as error:
        data = list(islice(csv_rows(file), 1, None))
        uneven = next(((line, cells) for line, cells in data if len(cells) != len(header)), None)
        if uneven is not None:
            message = f"{len(uneven[1])} columns, where the header has {len(header)}"
            raise InputError(message, file=file, line=uneven[0]) from None
        message = f"not valid CSV: {str(error).splitlines()[0]}" if data else "the file has no row of data"
        raise InputError(message, file=file) from None
    columns = [pc.utf8_trim_whitespace(column) for column in table.columns]
    is_blank = np.logical_and.reduce([pc.equal(column, "").to_numpy() for column in columns])
    table = pa.table({name: columns[header.index(name)] for name in names}).filter(pa.array(~is_blank))
    return Rows(file, table, lambda place: next(islice(csv_rows(file), place + 1, None))[0])


@contextmanager
def reading_parquet(file: Path) -> Iterator[None]:
    """Raise what Parquet's reader finds wrong with a file as an ``InputError``."""
    try:
        yield
    except (pa.ArrowException, OSError, ValueError, OverflowError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"not a Parquet file that can be read: {reason}", file=file) from None


def _parquet(file: Path, names: list[str]) -> Rows:
    with reading_parquet(file):
        require_columns(names, pq.read_schema(file).names, file, None)
        table = pq.read_table(file, columns=names)
        return Rows(file, pa.table({name: plain_column(name, table[name], file) for name in names}))


def require_columns(names: Sequence[str], header: Sequence[str], file: Path, line: int | None) -> None:
    """Refuse a table without one of the columns, or with two of its name."""
    # What is no table is not to be shown in a message.
    if not {*names} & {*header} and not all(_COLUMN.fullmatch(name) for name in header):
        wanted = f"; expected {', '.join(names)}" if names else ""
        raise InputError(f"this is no row of column names{wanted}", file=file, line=line)
    for name in names:
        if name not in header:
            names_there = [shortened_text(column, 40) for column in header]
            raise InputError(f"there is no column {name!r}; {nearest_choices(name, names_there)}", file=file, line=line)
        if header.count(name) > 1:
            raise InputError(f"there are {header.count(name)} columns {name!r}", file=file, line=line)
