"""Columns of tables: the numbers and times that Python itself would read, and the place of each cell that is none."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from trackbench.base.errors import InputError
from trackbench.truth.config.columns import Column
from trackbench.truth.recorded.rows import Rows, rows_of_columns
from trackbench.truth.recorded.table_files import read_table

#: A table whose third cell of x is at fault: text before it, and the line of the cell.
PLACES = {
    "plain": ("t,x\n0,1\n1,2\n", 4),
    "blank lines": ("t,x\n\n0,1\n   \n\n1,2\n,\n", 8),
    "line breaks in cells": ('t,x,"a\nb"\n0,1,"two\nlines"\n1,2,""\n', 6),
    "returns": ("t,x\r\n0,1\r\n1,2\r\n", 4),
    "byte order mark": ("\ufefft,x\n0,1\n1,2\n", 4),
}


def spellings(chance: np.random.Generator) -> list[str]:
    """Ways to write numbers."""
    values = chance.normal(size=200) * 10.0 ** chance.integers(-12, 9, 200)
    texts = [repr(float(value)) for value in values] + [f"{value:.3f}" for value in values]
    texts += [f"{value:+.17e}" for value in values] + [f" {value:.4G}\t" for value in values]
    return [*texts, "+1", ".5", "5.", "-0", "1e5", "1E-3", "0012", "9007199254740993"]


def as_csv(texts: list[str], folder: Path) -> Rows:
    (folder / "a.csv").write_text("x,y\n" + "".join(f"{text},0\n" for text in texts), encoding="utf-8")
    return read_table(folder / "a.csv", "csv", ["x"])


def as_parquet(texts: list[str], folder: Path) -> Rows:
    pq.write_table(pa.table({"x": texts}), folder / "a.parquet")
    return read_table(folder / "a.parquet", "parquet", ["x"])


@pytest.mark.parametrize("table", [as_csv, as_parquet, lambda texts, _: rows_of_columns(Path("a"), {"x": texts})])
def test_numbers_are_those_of_python_to_the_last_bit(table: Callable[..., Rows], tmp_path: Path) -> None:
    texts = spellings(np.random.default_rng(3))
    np.testing.assert_array_equal(table(texts, tmp_path).numbers(Column("x")), [float(text) for text in texts])


@pytest.mark.parametrize("text", ["x", "1,5", "1e", "0x1", "1_0", "\uff11", "inf", "1e400", "nan", "--1"])
def test_what_is_no_number_is_refused_with_its_row(text: str) -> None:
    rows = rows_of_columns(Path("a.parquet"), {"x": ["1", "2", text, "x"]})
    with pytest.raises(InputError, match="row 3: x is not a finite number: "):
        rows.numbers(Column("x"))


@pytest.mark.parametrize("name", PLACES)
def test_a_bad_cell_is_named_by_its_line(name: str, tmp_path: Path) -> None:
    text, line = PLACES[name]
    width = 3 if "cells" in name else 2
    newline = "\r\n" if "\r" in text else "\n"
    cells = [["2", "north", "end"], ["3", "4", "end"]]
    (tmp_path / "a.csv").write_text(text + "".join(",".join(row[:width]) + newline for row in cells), newline="")
    rows = read_table(tmp_path / "a.csv", "csv", ["t", "x"])
    assert rows.numbers(Column("t")).tolist() == [0, 1, 2, 3]
    for table in (rows, rows.only(np.array([False, True, True, False]))):
        with pytest.raises(InputError, match="x is not a finite number: 'north'") as caught:
            table.numbers(Column("x"))
        assert (caught.value.file, caught.value.line) == (tmp_path / "a.csv", line)


def test_optional_cells_may_be_empty_or_nan() -> None:
    rows = rows_of_columns(Path("a"), {"x": ["1", "", "NaN", " ", "2"], "y": [1, None, float("nan"), 2.5, 3]})
    np.testing.assert_array_equal(rows.numbers(Column("x", factor=2.0), optional=True), [2, np.nan, np.nan, np.nan, 4])
    np.testing.assert_array_equal(rows.numbers(Column("y"), optional=True), [1, np.nan, np.nan, 2.5, 3])
    with pytest.raises(InputError, match="row 2: x is not a finite number"):
        rows.numbers(Column("x"))


@pytest.mark.parametrize(("unit", "factor"), [(0, 1.0), (3, 1e-3), (6, 1e-6), (9, 1e-9)])
def test_times_since_1970_keep_their_nanoseconds_in_any_unit(unit: int, factor: float) -> None:
    exact = [Decimal("1714564800.123456789"), Decimal("1714564799.999999999"), Decimal("1714564900")]
    texts = [f"{time.scaleb(unit):f}" for time in exact]
    clock = rows_of_columns(Path("a"), {"t": texts}).times(Column("t", factor=factor))
    assert clock.start == 1714564799
    assert [Decimal(repr(time)) for time in clock.since(Decimal(1714564799)).tolist()] == [
        time - 1714564799 for time in exact
    ]


def test_names_come_in_the_order_of_the_rows() -> None:
    labels = rows_of_columns(Path("a"), {"id": ["b", " a", "b ", "nan"]}).labels("id", optional=True)
    assert labels.names == ["b", "a", ""]
    assert labels.of_rows == ["b", "a", "b", ""]
    assert rows_of_columns(Path("a"), {"id": [7, 3, 7]}).labels("id").of_rows == ["7", "3", "7"]
    with pytest.raises(InputError, match="row 2: id is empty, where the name of an object is expected"):
        rows_of_columns(Path("a"), {"id": ["b", ""]}).labels("id")


def test_a_time_that_cannot_be_meant_is_named_by_its_own_row() -> None:
    rows = rows_of_columns(Path("a.parquet"), {"t": ["0", "1", "-1e308", "2"]})
    with pytest.raises(InputError, match=r"row 3: t is '-1e308': .* can be meant: check its unit"):
        rows.times(Column("t"))
