"""Positions, velocities, times and names that no truth has, in files and in scripts."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.runner.test_recorded_tables import HEAD, ROWS, load, write
from tests.support.udacity import synthetic_lines

from trackbench.base.errors import InputError
from trackbench.truth.recorded.udacity import parse_line
from trackbench.truth.sources import ScriptedTruth

# The column of the table's third row, what stands there, and what is said of it.
CELLS = [
    ("y_km", 1e30, "y_km is '1e+30': it would be 1e+33 m, and -1e+08 to 1e+08 m can be meant: check its unit"),
    ("v_kmph", -1e308, "v_kmph is '-1e+308': it would be -2.78e+307 m/s"),
    ("az_deg", 1e30, "az_deg is '1e+30': it would be 1.75e+28 rad"),
    ("r_km", 1e6, "r_km is '1000000.0': it would be 1e+09 m"),
    ("t_ms", 1e12, "t_ms: 1e+09 s after the first, and a recording lasts 86400 s at most: check the unit of time"),
    ("who", "a\x01", r"who is 'a\x01', where the name of an object is expected"),
]


@pytest.mark.parametrize("form", ["csv", "parquet"])
@pytest.mark.parametrize(("column", "value", "message"), CELLS)
def test_a_cell(tmp_path: Path, form: str, column: str, value: object, message: str) -> None:
    file = tmp_path / f"log.{form}"
    rows = [list(row) for row in ROWS]
    rows[3][HEAD.index(column)] = value
    write(file, rows)
    with pytest.raises(InputError) as caught:
        load(file)
    place = f"{file}:5: " if form == "csv" else f"{file}: row 4: "
    assert str(caught.value).startswith(place)
    assert message in str(caught.value)


def test_largest_values_that_can_be_meant(tmp_path: Path) -> None:
    rows = [list(row) for row in ROWS]
    rows[3][HEAD.index("y_km")] = 9e4
    write(tmp_path / "log.csv", rows)
    assert load(tmp_path / "log.csv").truth.py.max() == 9e7


def test_a_line_of_the_simulator() -> None:
    for column in (1, 4, 5):
        cells = synthetic_lines(1)[0].split()
        cells[column if column == 1 else column + 1] = "1e30"
        with pytest.raises(InputError, match="not a finite number that can be meant"):
            parse_line(" ".join(cells))


def script(**body: object) -> ScriptedTruth:
    truth = {"source": "scripted", "duration_s": 60, "rate_hz": 10, "objects": {"car": body}}
    return ScriptedTruth.model_validate(truth)


def test_an_acceleration_that_cannot_be_meant() -> None:
    with pytest.raises(ValueError, match="it must be at most 1000"):
        script(pieces=[{"acceleration_mps2": 200000}])


@pytest.mark.parametrize("start", [{"x": 1e300}, {"speed_mps": 1e6}, {"vx_mps": -1e308}])
def test_a_start_that_cannot_be_meant(start: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"it must be at (most|least)"):
        script(start=start)
