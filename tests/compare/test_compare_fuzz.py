"""Results that are damaged at random: each is compared, or refused in one line."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from trackbench.base.errors import InputError
from trackbench.compare import compare_results, find_results
from trackbench.results import Result

pytestmark = pytest.mark.slow

EDITS = 300
OTHERS = (None, -1, 0, 1e300, "", "x", [], {}, True, [1, 2])


@pytest.fixture
def two(run_tiny: Callable[..., Result], tmp_path: Path) -> tuple[Path, Path]:
    """Two equal results, of which the second is to be damaged."""
    run_tiny("monte_carlo.runs=6").save(tmp_path / "base", {})
    shutil.copytree(tmp_path / "base", tmp_path / "later")
    return tmp_path / "base", tmp_path / "later"


def refusal(base: Path, later: Path) -> str:
    """The one line that refuses a comparison of two results or of the later one's trackers; empty where none does."""
    try:
        for paths in ((base, later), (later,)):
            found = compare_results([find_results(path) for path in paths], metrics=["position_rmse", "nees.mean"])
            json.dumps(found.json(), allow_nan=False)
    except InputError as error:
        return str(error)
    return ""


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every place in JSON values."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [found for key, part in inner for found in ((*path, key), *places(part, (*path, key)))]


def test_edits_of_the_summary(two: tuple[Path, Path]) -> None:
    random = np.random.default_rng(11)
    file = two[1] / "result.json"
    text = file.read_text(encoding="utf-8")
    known = places(json.loads(text))
    refused = 0
    for _ in range(EDITS):
        raw = json.loads(text)
        *way, last = known[random.integers(len(known))]
        node = raw
        for key in way:
            node = node[key]
        if random.integers(4) == 0:
            del node[last]
        else:
            node[last] = OTHERS[random.integers(len(OTHERS))]
        file.write_text(json.dumps(raw), encoding="utf-8")
        line = refusal(*two)
        assert "\n" not in line
        refused += bool(line)
    assert 50 < refused < EDITS


def edited(table: pa.Table, column: int, kind: int, random: np.random.Generator) -> pa.Table:
    """A table with a column or its rows changed."""
    name, rows = table.column_names[column], len(table)
    if kind == 0:
        return table.drop_columns([name])
    if kind == 1:
        return table.slice(int(random.integers(rows)))
    if kind == 2:
        return table.take(random.permutation(rows))
    values = (
        pa.array([None] * rows, table.schema.field(column).type),
        pa.array(["x"] * rows),
        pa.array([[1]] * rows),
        pa.array(np.full(rows, random.choice([np.nan, np.inf, -1.0, 1e300]))),
    )
    return table.set_column(column, name, values[kind - 3])


def test_edits_of_the_tables(two: tuple[Path, Path]) -> None:
    random = np.random.default_rng(12)
    tables = {name: pq.read_table(two[1] / f"{name}.parquet") for name in ("runs", "truth")}
    refused = 0
    for _ in range(EDITS):
        name = ("runs", "truth")[random.integers(2)]
        table, file = tables[name], two[1] / f"{name}.parquet"
        pq.write_table(edited(table, int(random.integers(table.num_columns)), int(random.integers(7)), random), file)
        line = refusal(*two)
        assert "\n" not in line
        refused += bool(line)
        pq.write_table(table, file)
    assert 50 < refused < EDITS
