"""Types of the columns of a Parquet file: single numbers, texts and times are read, and nothing becomes another."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.runner.test_recorded_tables import HEAD, ROWS, load, write
from tests.support.traffic_files import WRITERS

from trackbench.base.errors import InputError
from trackbench.truth.tracks import TRAFFIC_FORMATS

Values = Callable[[list[Any]], pa.Array]
OTHERS: dict[str, Values] = {
    "bool": lambda values: pa.array([True] * len(values)),
    "list<": lambda values: pa.array([[value] for value in values]),
    "struct<": lambda values: pa.array([{"value": value} for value in values]),
    "map<": lambda values: pa.array([[("a", 1)] for _ in values], pa.map_(pa.string(), pa.int8())),
    "binary": lambda values: pa.array([str(value).encode() for value in values]),
    "duration": lambda values: pa.array([datetime.timedelta(1)] * len(values)),
    "fixed_size_binary": lambda values: pa.array([b"1"] * len(values), pa.binary(1)),
}
#: Times are no coordinates.
STAMPS: dict[str, Values] = {
    "date": lambda values: pa.array([datetime.date(2020, 1, 1)] * len(values)),
    "timestamp": lambda values: pa.array([datetime.datetime(2020, 1, 1)] * len(values)),
    "time": lambda values: pa.array([datetime.time(1)] * len(values)),
}
#: The same numbers.
NUMBERS: dict[str, Values] = {
    "text": lambda values: pa.array([repr(float(value)) for value in values]),
    "decimal": lambda values: pa.array([Decimal(float(value)).quantize(Decimal(10) ** -20) for value in values]),
    "dictionary": lambda values: pa.array(values).dictionary_encode(),
}


def rows_with(folder: Path, column: str, made: Values) -> Any:
    """The rows of a file of traffic of which a column has another type."""
    file = WRITERS["parquet"](folder)
    table = pq.read_table(file)
    place = table.column_names.index(column)
    pq.write_table(table.set_column(place, column, made(table[column].to_pylist())), file)
    return TRAFFIC_FORMATS["parquet"]().rows(file)  # type: ignore[attr-defined]


@pytest.mark.parametrize("column", ["time", "id", "x", "heading", "class"])
@pytest.mark.parametrize("kind", OTHERS)
def test_a_column_of_another_kind_is_refused(tmp_path: Path, kind: str, column: str) -> None:
    with pytest.raises(InputError) as caught:
        rows_with(tmp_path, column, OTHERS[kind])
    file, message = str(caught.value).split(": ", 1)
    assert file.endswith(".parquet")
    assert message.startswith(f"{column} is a column of {kind}")
    assert message.endswith(", where numbers or texts are expected")


@pytest.mark.parametrize("column", ["x", "y", "heading"])
@pytest.mark.parametrize("kind", STAMPS)
def test_a_time_is_no_coordinate(tmp_path: Path, kind: str, column: str) -> None:
    with pytest.raises(InputError, match=rf"\.parquet: row 1: {column} is not a finite number"):
        rows_with(tmp_path, column, STAMPS[kind])


@pytest.mark.parametrize("column", ["time", "x", "y"])
@pytest.mark.parametrize("kind", NUMBERS)
def test_a_number_of_any_type_is_the_same_number(tmp_path: Path, kind: str, column: str) -> None:
    before = rows_with(tmp_path, column, pa.array)
    after = rows_with(tmp_path, column, NUMBERS[kind])
    for name in ("time", "px", "py"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))


@pytest.mark.parametrize("column", ["t_ms", "who", "y_km", "v_kmph"])
def test_so_it_is_in_a_log(tmp_path: Path, column: str) -> None:
    file = tmp_path / "log.parquet"
    rows = [list(row) for row in ROWS]
    write(file, rows)
    table = pq.read_table(file)
    flags = pa.array([True] * len(table))
    pq.write_table(table.set_column(HEAD.index(column), column, flags), file)
    with pytest.raises(InputError, match=f"{column} is a column of bool, where numbers or texts are expected"):
        load(file)
