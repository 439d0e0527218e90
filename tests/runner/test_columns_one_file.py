"""One declaration in one file makes a column: the run's table has it, with its unit, and a stored table is checked."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.runner.test_traffic_runs import SCENARIO

import trackbench as tb
from trackbench.base.errors import InputError
from trackbench.results import Result
from trackbench.results.declared import HIDDEN, LABELLED

CODE = """
import numpy as np
from trackbench.results.columns import TableColumn
from trackbench.results.declared import declare

declare("estimates", TableColumn("speed_mps", "m/s", lambda record: np.hypot(*record["mean"][2:]), required=True))
declare("steps", TableColumn("estimated_share", "1", lambda record: record["count"] / record["count"].max()))
declare("tracks", TableColumn("speed_mps", "m/s", lambda record: np.hypot(*record["mean"][2:])), hidden=True)
declare("runs", TableColumn("nowhere", "1", "an entry that no record has"))
"""


@pytest.fixture
def declared(
    tmp_path: Path, write_module: Callable[[Path, str], str], monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    """The columns of a module that nothing of the bench names."""
    tables = [*LABELLED.values(), *HIDDEN.values()]
    before = [list(table.columns) for table in tables]
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module(write_module(tmp_path, CODE))
    yield
    for table, columns in zip(tables, before, strict=True):
        table.columns[:] = columns


@pytest.mark.usefixtures("declared")
def test_a_run_has_the_column_and_a_stored_one_is_checked(run_tiny: Callable[..., Result], tmp_path: Path) -> None:
    run_tiny().save(tmp_path / "run")
    result = Result.load(tmp_path / "run")
    estimates = result.to_pandas("estimates")
    np.testing.assert_array_equal(estimates["speed_mps"], np.hypot(estimates["vx_mps"], estimates["vy_mps"]))
    assert result.to_pandas("steps")["estimated_share"].max() == 1
    assert "nowhere" not in result.tables.runs.column_names
    assert {column.name: column.unit for column in LABELLED["estimates"].columns}["speed_mps"] == "m/s"
    file = tmp_path / "run" / "estimates.parquet"
    table = pq.read_table(file)
    for damaged, message in (
        (table.drop_columns(["speed_mps"]), "no column speed_mps"),
        (
            table.set_column(table.num_columns - 1, "speed_mps", pa.array(["fast"] * len(table))),
            "speed_mps is a column of string",
        ),
    ):
        pq.write_table(damaged, file)
        with pytest.raises(InputError, match=message):
            _ = Result.load(tmp_path / "run").tables.estimates


@pytest.mark.usefixtures("declared")
def test_tracks_have_the_column(tmp_path: Path) -> None:
    (tmp_path / "lanes.yaml").write_text(SCENARIO, encoding="utf-8")
    tracks = tb.run(tmp_path / "lanes.yaml").to_pandas("tracks")
    np.testing.assert_array_equal(tracks["speed_mps"], np.hypot(tracks["vx_mps"], tracks["vy_mps"]))
