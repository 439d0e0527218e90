"""What the comparison of two commits' numbers takes for the same."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from benchmarks.same_numbers import compared
from benchmarks.same_numbers_values import read

RESULT = {
    "trackers": [
        {"name": "ekf", "describe": "ekf, sigma 3", "metrics": {"rmse": {"value": 0.1}, "step_time": {"value": 8.0}}},
        {"name": "ukf", "describe": "ukf, sigma 2", "metrics": {"rmse": {"value": 0.2}, "step_time": {"value": 9.0}}},
    ],
    "versions": {"numpy": "2"},
    "seed": 7,
}
TABLE = {"tracker": ["ekf", "ekf", "ukf"], "nees": [4.0, float("nan"), None], "run": [0, 1, 0]}


@pytest.fixture
def of(tmp_path):
    """The values of a saved result."""

    def saved(result=RESULT, table=TABLE, name="runs.parquet"):
        folder = tmp_path / str(len(list(tmp_path.iterdir()))) / "highway"
        folder.mkdir(parents=True)
        Path(folder, "result.json").write_text(json.dumps(result), encoding="utf-8")
        pyarrow.parquet.write_table(pa.table(table), folder / name)
        return read(folder.parent, "highway")

    return saved


def changed(path, value, of=RESULT):
    """A result with another value at a path."""
    copy = json.loads(json.dumps(of))
    place = copy
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return copy


def test_equal(of):
    outcome = compared(of(), of())
    assert outcome.differences == outcome.notes == []
    assert outcome.values == 7 + 9 + 1


def test_last_bit(of):
    path = ("trackers", 1, "metrics", "rmse", "value")
    outcome = compared(of(), of(changed(path, float(np.nextafter(0.2, 1)))))
    assert outcome.differences == ["result.json:trackers[ukf].metrics.rmse.value: 0.2 -> 0.20000000000000004"]


@pytest.mark.parametrize(
    ("column", "values", "difference"),
    [
        ("nees", [4.0, np.nextafter(0, 1), None], "[1]: np.float64(nan) -> np.float64(5e-324) (1 of 3 rows)"),
        ("nees", [4.0, None, None], "[1]: np.float64(nan) -> null (1 of 3 rows)"),
        ("run", [0, 0, 1], "[1]: np.int64(1) -> np.int64(0) (2 of 3 rows)"),
        ("run", [-0.0, 1.0, 0.0], ": int64 -> float64"),
        ("tracker", ["ekf", "ukf", "ukf"], "[1]: 'ekf' -> 'ukf' (1 of 3 rows)"),
    ],
)
def test_column(of, column, values, difference):
    outcome = compared(of(), of(table={**TABLE, column: values}))
    assert outcome.differences == [f"runs.parquet:{column}{difference}"]
