"""Recordings as CSV and Parquet tables with columns and units of the user's own."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from trackbench.base.errors import InputError
from trackbench.truth import Draw, LoadedTruth
from trackbench.truth.sources import RecordingTruth

#: Two cars, at irregular times; the second is seen later. km, km/h and degrees.
HEAD = ["t_ms", "who", "x_km", "y_km", "v_kmph", "course_deg", "r_km", "az_deg", "rr_kmph"]
ROWS = [
    [1000, "a", 0.010, 0.020, 36.0, 90.0, 0.021, 1.5, -18.0],
    [1030, "a", 0.010, 0.0203, 36.0, 90.0, "", "", ""],
    [1030, "b", 0.050, 0.000, 72.0, 180.0, 0.051, 190.0, 3.6],
    [1100, "a", 0.010, 0.021, 36.0, 90.0, 0.022, 2.5, -17.0],
    [1250, "b", 0.0456, 0.000, 72.0, 180.0, "", "", ""],
]
MOTION = {"px": "x_km:km", "py": "y_km:km", "speed": "v_kmph:kmph", "course": "course_deg:deg"}
COLUMNS = {"time": "t_ms:ms", "object": "who", **MOTION}
MEASUREMENTS = {"front": {"range": "r_km:km", "azimuth": "az_deg:deg", "range_rate": "rr_kmph:kmph"}}


def write(file: Path, rows: list[list[object]] = ROWS, head: list[str] = HEAD) -> None:
    if file.suffix == ".parquet":
        cells = [[None if cell == "" else cell for cell in column] for column in zip(*rows, strict=True)]
        pq.write_table(pa.table(dict(zip(head, cells, strict=True))), file)
        return
    with file.open("w", newline="") as stream:
        csv.writer(stream).writerows([head, *rows])


def load(file: Path, **keys: object) -> LoadedTruth:
    form = file.suffix[1:]
    entry = {"columns": COLUMNS, "readings": MEASUREMENTS, **keys}
    config = RecordingTruth.model_validate({"source": "recording", "format": form, "path": file.name, **entry})
    return config.load(Draw(0, "test", 1), folder=file.parent, sensors={"front": "radar", "roof": "lidar"})


@pytest.fixture(params=["csv", "parquet"])
def file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return tmp_path / f"log.{request.param}"


def test_columns_and_units_become_si(file: Path) -> None:
    write(file)
    truth = load(file).truth
    assert truth.ids == ("a", "b")
    np.testing.assert_allclose(truth.time, [0, 0.03, 0.1, 0.25])
    np.testing.assert_allclose(truth.py[:3, 0, 0], [20, 20.3, 21])
    np.testing.assert_allclose(truth.vy[:3, 0, 0], 10)
    np.testing.assert_allclose(truth.vx[1:, 1, 0], -20)
    # Between its own rows an object is where the straight line between them is.
    np.testing.assert_allclose(truth.px[1:, 1, 0], [50, 50 - 4.4 * 0.07 / 0.22, 45.6])


def test_empty_cells_are_no_measurements(file: Path) -> None:
    write(file)
    found = load(file).measurements["front"]
    assert found.steps.tolist() == [0, 1, 2]
    np.testing.assert_array_equal(found.valid, [[1, 0], [0, 1], [1, 0]])
    np.testing.assert_allclose(found.measurement[:, 0, 0], [21, np.deg2rad(1.5), -5])
    np.testing.assert_allclose(found.measurement[:, 1, 1], [51, np.deg2rad(-170), 1])


def test_measurements_of_a_second_file_at_times_of_their_own(file: Path) -> None:
    write(file)
    other = file.with_name(f"lidar{file.suffix}")
    write(other, [[1010, "a", 1.0, 2.0], [1100, "b", 3.0, 4.0]], ["stamp", "id", "fore", "left"])
    entry = {"path": other.name, "time": "stamp:ms", "object": "id", "x": "fore:km", "y": "left:km"}
    loaded = load(file, readings={"roof": entry})
    np.testing.assert_allclose(loaded.truth.time, [0, 0.01, 0.03, 0.1, 0.25])
    np.testing.assert_allclose(loaded.truth.py[:2, 0, 0], [20, 20.1])
    found = loaded.measurements["roof"]
    assert found.steps.tolist() == [1, 3]
    np.testing.assert_allclose(found.measurement[:, 0, 0], [1000, 2000])
    np.testing.assert_array_equal(found.valid, [[1, 0], [0, 1]])


def test_nanoseconds_since_1970_keep_their_differences(file: Path) -> None:
    start = 1_477_010_443_000_000_000
    write(file, [[start + 10 * k, "a", 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0] for k in range(3)])
    np.testing.assert_allclose(
        load(file, columns={**COLUMNS, "time": "t_ms:ns"}).truth.time, [0, 1e-8, 2e-8], rtol=1e-12
    )


def changed(row: int, column: str, value: object) -> list[list[object]]:
    rows = [list(item) for item in ROWS]
    rows[row][HEAD.index(column)] = value
    return rows


# What is wrong in both formats: rows, the row at fault (from 0; None: the file), and what is said.
DAMAGED = {
    "NaN": (changed(1, "x_km", float("nan")), 1, "x_km is not a finite number: 'nan'"),
    "empty": (changed(3, "y_km", ""), 3, "y_km is not a finite number: "),
    "half a measurement": (
        changed(3, "az_deg", ""),
        3,
        "az_deg is empty, but other columns of the same measurement are not",
    ),
    "no name": (changed(2, "who", ""), 2, "who is empty, where the name of an object is expected"),
    "no measurement": ([ROWS[1], ROWS[4]], None, "there is no measurement in r_km, az_deg, rr_kmph"),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_damaged_row_is_refused_with_its_number(file: Path, name: str) -> None:
    rows, row, message = DAMAGED[name]
    write(file, rows)
    with pytest.raises(InputError) as caught:
        load(file)
    assert message in caught.value.message
    assert caught.value.file == file
    if row is not None and file.suffix == ".csv":
        assert caught.value.line == row + 2
    elif row is not None:
        assert caught.value.message.startswith(f"row {row + 1}: ")


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("", None, "empty"),
        ("t_ms,who\n1,a,7\n", 2, "3 columns, where the header has 2"),
        ('t_ms,who\n1,"a\n', None, "not valid CSV"),
        ("t_ms,t_ms\n1,2\n", 1, "2 columns 't_ms'"),
        ("t_ms,who\n1,a\n\n1x,a\n", 4, "not a finite number: '1x'"),
        ("t_ms,who\n1,a\n1_0,a\n", 3, "not a finite number: '1_0'"),
    ],
)
def test_damaged_csv_is_refused_with_its_line(tmp_path: Path, text: str, line: int | None, message: str) -> None:
    file = tmp_path / "log.csv"
    file.write_text(text)
    names = {"time": "t_ms", "px": "t_ms", "py": "t_ms", "vx": "t_ms", "vy": "t_ms"}
    with pytest.raises(InputError, match=message) as caught:
        load(file, columns=names, readings={})
    assert (caught.value.file, caught.value.line) == (file, line)


@pytest.mark.parametrize(
    ("rows", "line", "message"),
    [
        ([[900, "a", 1.0, 2.0]], None, "only 0 of 1 measurements of roof .* lie within the time of the truth"),
        ([[1200, "a", 1.0, 2.0]], None, r"from 0 to 0.25 s\): check the units of time"),
        ([[1010, "c", 1.0, 2.0]], 2, "the truth has no object 'c'; choose from: a, b"),
    ],
)
def test_measurements_without_truth_are_refused(
    tmp_path: Path, rows: list[list[object]], line: int | None, message: str
) -> None:
    file, other = tmp_path / "log.csv", tmp_path / "lidar.csv"
    write(file)
    write(other, rows, ["t_ms", "who", "fore", "left"])
    with pytest.raises(InputError, match=message) as caught:
        load(file, readings={"roof": {"path": other.name, "x": "fore:km", "y": "left:km"}})
    assert (caught.value.file, caught.value.line) == (other if line else None, line)


def test_what_lies_outside_the_truth_is_left_out_and_counted(file: Path) -> None:
    write(file)
    other = file.with_name(f"lidar{file.suffix}")
    rows = [[999.982, "a", 9.0, 9.0], [1010, "a", 1.0, 2.0], [1200, "a", 9.0, 9.0], [1300, "b", 9.0, 9.0]]
    write(other, rows, ["t_ms", "who", "fore", "left"])
    loaded = load(file, readings={"roof": {"path": other.name, "x": "fore:km", "y": "left:km"}})
    assert loaded.truth.source["left_out"] == {"roof": {"outside the time of the truth": 3}}
    assert loaded.notes[1:] == ("roof: left out 3 rows outside the time of the truth",)
    found = loaded.measurements["roof"].measurement
    assert found[np.isfinite(found)].tolist() == [1000, 2000]


def test_rows_out_of_order_are_sorted_and_doubles_left_out(file: Path) -> None:
    write(file)
    plain = load(file)
    write(file, [ROWS[2], ROWS[0], ROWS[1], ROWS[1], ROWS[4], ROWS[3]])
    mixed = load(file)
    np.testing.assert_allclose(mixed.truth.time, plain.truth.time)
    assert plain.notes == ("no observer is stated: the sensors stand at x = 0, y = 0 with yaw 0",)
    assert mixed.notes[1] == "truth: left out 1 rows of an object and a time that came before"
    of = {name: i for i, name in enumerate(mixed.truth.ids)}
    for i, name in enumerate(plain.truth.ids):
        np.testing.assert_allclose(mixed.truth.px[:, of[name]], plain.truth.px[:, i])
        np.testing.assert_array_equal(
            mixed.measurements["front"].measurement[:, :, of[name]], plain.measurements["front"].measurement[:, :, i]
        )


def test_a_known_bias_is_subtracted_and_late_stamps_are_put_right(file: Path) -> None:
    write(file)
    entry = {**MEASUREMENTS["front"], "bias": {"range": 0.001}, "time_offset_s": -0.02}
    loaded = load(file, readings={"front": entry})
    # The first measurement of a, 20 ms earlier, lies before the truth.
    assert loaded.truth.source["left_out"] == {"front": {"outside the time of the truth": 2}}
    found = loaded.measurements["front"]
    np.testing.assert_allclose(loaded.truth.time[found.steps[found.valid.any(axis=1)]], [0.08])
    assert np.nanmax(found.measurement[0]) == pytest.approx(21)


def test_the_observer_may_have_a_file_of_its_own(file: Path) -> None:
    write(file)
    other = file.with_name(f"ego{file.suffix}")
    poses = [[k * 1_000, 10 * (k / 1000 - 1), 0.0, (170 + 0.1 * (k - 1000)) % 360] for k in range(990, 1300, 10)]
    write(other, poses, ["stamp", "east", "north", "yaw"])
    observer = {"path": other.name, "time": "stamp:us", "px": "east", "py": "north", "yaw": "yaw:deg"}
    truth = load(file, ego=observer).truth
    np.testing.assert_allclose(truth.time, [0, 0.03, 0.1, 0.25])
    np.testing.assert_allclose(truth.observer.px, 10 * truth.time, atol=1e-9)
    np.testing.assert_allclose(truth.observer.vx, 10)
    np.testing.assert_allclose(np.rad2deg(truth.observer.yaw), 170 + 100 * truth.time)
    np.testing.assert_allclose(np.rad2deg(truth.observer.yaw_rate), 100)


def test_what_lies_outside_the_observers_time_is_left_out(file: Path) -> None:
    write(file)
    other = file.with_name(f"ego{file.suffix}")
    write(other, [[1020, 0.0, 0.0, 0.0], [1260, 0.001, 0.0, 0.0]], ["t_ms", "east", "north", "yaw"])
    observer = {"path": other.name, "px": "east", "py": "north", "yaw": "yaw"}
    loaded = load(file, ego=observer)
    np.testing.assert_allclose(loaded.truth.time, [0.03, 0.1, 0.25])
    assert loaded.truth.source["left_out"] == {
        "truth": {"outside the time of the observer": 1},
        "front": {"outside the time of the truth": 1},
    }
    write(other, [[1020000, 0.0, 0.0, 0.0], [1260000, 0.001, 0.0, 0.0]], ["t_ms", "east", "north", "yaw"])
    with pytest.raises(InputError, match="check the units of time"):
        load(file, ego=observer)


def cars(folder: Path, period: float, keep: list[int]) -> LoadedTruth:
    """A car that a radar sees at some of its scans."""
    file = folder / "truth.csv"
    write(file, [[0.1 * k, 20.0 + k, 0.0, 10.0, 0.0] for k in range(51)], ["t", "x", "y", "u", "v"])
    rows = [[period * k, 20.0, 0.0, 10.0] for k in keep]
    write(folder / "radar.csv", rows, ["t", "r", "az", "rr"])
    columns = {"time": "t", "px": "x", "py": "y", "vx": "u", "vy": "v"}
    front = {"path": "radar.csv", "range": "r", "azimuth": "az", "range_rate": "rr"}
    return load(file, columns=columns, readings={"front": front})


def test_scans_that_detected_nothing_are_found_by_the_period(tmp_path: Path) -> None:
    keep = [k for k in range(80) if k % 7 in (0, 1, 4)]
    found = cars(tmp_path, 0.0500001, keep).measurements["front"]
    assert found.valid.sum() == len(keep)
    # From the first row to the last; after it nothing says that the radar still looked.
    assert len(found.steps) == max(keep) + 1


def test_irregular_rows_have_no_scans_between_them(tmp_path: Path) -> None:
    times = np.cumsum(np.random.default_rng(1).exponential(0.1, 40))
    keep = [float(time) / 0.05 for time in times if time < 5]
    found = cars(tmp_path, 0.05, keep).measurements["front"]
    assert len(found.steps) == len(keep)


@pytest.mark.parametrize(
    ("columns", "head", "message"),
    [
        ({**COLUMNS, "speed": "v_kmph:km/h"}, HEAD, "'km/h' after column 'v_kmph' is no unit of what the column has: "),
        ({**COLUMNS, "speed": "v_kmph:deg"}, HEAD, "'deg' after column 'v_kmph' is no unit"),
        (COLUMNS, [";".join(HEAD)], "are separated by commas"),
    ],
)
def test_a_unit_and_a_separator_that_are_none_are_said(
    tmp_path: Path, columns: dict[str, str], head: list[str], message: str
) -> None:
    file = tmp_path / "log.csv"
    write(file, ROWS if head is HEAD else [[";".join(map(str, row))] for row in ROWS], head)
    with pytest.raises(InputError, match=message):
        load(file, columns=columns)
