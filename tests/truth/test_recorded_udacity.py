"""Recordings in the format of the Udacity simulator."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tests.support.udacity import synthetic_lines

from trackbench.base.errors import InputError
from trackbench.truth import Draw, LoadedTruth
from trackbench.truth.sources import RecordingTruth

KINDS = {"roof": "lidar", "front": "radar"}
LINES = synthetic_lines(8)


def load(file: Path, kinds: dict[str, str] = KINDS) -> LoadedTruth:
    config = RecordingTruth(source="recording", format="udacity", path=file.name)
    return config.load(Draw(0, "test", 1), folder=file.parent, sensors=kinds)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "log.txt"


def test_truth_and_measurements_are_those_of_the_lines(file: Path) -> None:
    file.write_text("\n".join(LINES) + "\n")
    loaded = load(file)
    values = [[float(v) for v in line.split()[1:]] for line in LINES]
    truth = loaded.truth
    np.testing.assert_allclose(truth.time, 0.05 * np.arange(8), atol=1e-9)
    got = np.stack([truth.px, truth.py, truth.vx, truth.vy])[:, :, 0, 0]
    np.testing.assert_allclose(got.T, [row[-4:] for row in values], rtol=1e-12)
    assert loaded.measurements is not None
    assert loaded.measurements["roof"].steps.tolist() == [0, 2, 4, 6]
    assert loaded.measurements["front"].steps.tolist() == [1, 3, 5, 7]
    np.testing.assert_allclose(loaded.measurements["roof"].measurement[:, :, 0].T, [row[:2] for row in values[::2]])
    np.testing.assert_allclose(loaded.measurements["front"].measurement[:, :, 0].T, [row[:3] for row in values[1::2]])
    assert all(item.valid.all() for item in loaded.measurements.values())


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text.replace("\t", "  "),
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\n\n  \n"),
        lambda text: text.rstrip("\n"),
        lambda text: "\ufeff" + text,
    ],
    ids=["spaces", "crlf", "blank lines", "no final newline", "byte order mark"],
)
def test_white_space_does_not_matter(file: Path, damage) -> None:
    text = "\n".join(LINES) + "\n"
    file.write_text(text)
    plain = load(file)
    file.write_bytes(damage(text).encode())
    other = load(file)
    np.testing.assert_array_equal(plain.truth.px, other.truth.px)
    for name in KINDS:
        np.testing.assert_array_equal(plain.measurements[name].measurement, other.measurements[name].measurement)


@pytest.mark.parametrize("extra", [[], ["0.7"], ["0.7", "0.2"]], ids=["vy", "yaw", "yaw rate"])
def test_files_may_end_after_vy_yaw_or_yaw_rate(file: Path, extra: list[str]) -> None:
    file.write_text("\n".join("\t".join([line, *extra]) for line in LINES))
    truth = load(file).truth
    course = np.arctan2(truth.vy, truth.vx)
    np.testing.assert_allclose(truth.heading, np.full_like(course, 0.7) if extra else course)
    if len(extra) == 2:
        np.testing.assert_allclose(truth.yaw_rate, 0.2)


def test_azimuths_beyond_half_a_turn_are_wrapped(file: Path) -> None:
    row = LINES[1].split("\t")
    row[2] = "3.190031"
    file.write_text("\n".join([LINES[0], "\t".join(row)]))
    assert load(file).measurements["front"].measurement[1, 0, 0] == pytest.approx(3.190031 - 2 * math.pi)


def test_sensors_that_the_scenario_does_not_have_leave_the_truth_whole(file: Path) -> None:
    file.write_text("\n".join(LINES))
    loaded = load(file, {"front": "radar"})
    assert set(loaded.measurements) == {"front"}
    assert len(loaded.truth.time) == len(LINES)


def swapped(lines: list[str], a: int, b: int) -> list[str]:
    lines = list(lines)
    lines[a], lines[b] = lines[b], lines[a]
    return lines


def cell(line: int, column: int, value: str) -> list[str]:
    row = LINES[line].split("\t")
    row[column] = value
    return [*LINES[:line], "\t".join(row), *LINES[line + 1 :]]


DAMAGED = {
    "truncated": ([*LINES[:3], LINES[3][:30]], 4, "the R line has"),
    "no truth": (
        [LINES[0].rsplit("\t", 4)[0]],
        1,
        "the L line has 3 columns after its letter",
    ),
    "NaN": (cell(2, 1, "nan"), 3, "px is not a finite number that can be meant: 'nan'"),
    "infinite": (cell(1, 3, "1e999"), 2, "range rate is not a finite number"),
    "not a number": (cell(1, 2, "north"), 2, "azimuth is not a finite number that can be meant: 'north'"),
    "true NaN": (cell(1, -1, "NaN"), 2, "true vy is not a finite number"),
    "letter": (["X" + LINES[0][1:]], 1, "a line begins with L (lidar) or R (radar), not 'X'"),
    "backwards": (swapped(LINES, 4, 5), 6, "us is out of order"),
    "twice": ([LINES[0], LINES[0]], 2, "or the second at this time"),
    "time": (cell(0, 3, "1.5"), 1, "a whole number of microseconds, not '1.5'"),
    "columns": ([LINES[0] + "\t1\t2\t3"], 1, "the L line has 10 columns after its letter"),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_damaged_line_is_refused_with_its_number(file: Path, name: str) -> None:
    lines, number, message = DAMAGED[name]
    file.write_text("\n".join(lines))
    with pytest.raises(InputError) as caught:
        load(file)
    assert (caught.value.file, caught.value.line) == (file, number)
    assert message in caught.value.message


@pytest.mark.parametrize(
    ("content", "line", "message"),
    [(b"", None, "empty"), (b" \n\n", None, "empty"), (b"L\t1\n\xff\xfe", 2, "not UTF-8")],
)
def test_file_that_is_no_text_is_refused(file: Path, content: bytes, line: int | None, message: str) -> None:
    file.write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        load(file)
    assert (caught.value.file, caught.value.line) == (file, line)


def test_recording_without_a_sensors_lines_is_refused(file: Path) -> None:
    file.write_text("\n".join(LINES[::2]))
    with pytest.raises(InputError, match="no line of a radar, which sensor front is"):
        load(file)


def test_variables_in_the_path(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file.write_text("\n".join(LINES))
    config = RecordingTruth(source="recording", format="udacity", path="$TRACKBENCH_DATA/log.txt")
    monkeypatch.setenv("TRACKBENCH_DATA", str(file.parent))
    assert len(config.load(Draw(0, "test", 1), folder=Path("/"), sensors=KINDS).truth.time) == len(LINES)
    monkeypatch.delenv("TRACKBENCH_DATA")
    with pytest.raises(
        InputError, match="TRACKBENCH_DATA is not set; set it, such as to the folder that holds recordings"
    ) as caught:
        config.load(Draw(0, "test", 1), folder=Path("/"), sensors=KINDS)
    assert caught.value.key == "truth.path"
