"""A recording is read back without loss and without a viewer; what cannot be read is said in one message."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
import rerun as rr

from trackbench.base.errors import InputError
from trackbench.metrics.recorded_run import recorded_estimates, worst
from trackbench.report.numbers import rounded
from trackbench.results import Result
from trackbench.subjects.recording import data
from trackbench.subjects.recording import writer as recording
from trackbench.subjects.recording.data import TABLES, read
from trackbench.subjects.recording.focus import Opening, worst_moments
from trackbench.subjects.recording.inspection import errors_at


@pytest.fixture(scope="module")
def save(run_tiny: Callable[..., Result], tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Runs the tiny scenario and saves it with its recording."""

    def call(*overrides: str) -> Path:
        result = run_tiny(*overrides)
        folder = tmp_path_factory.mktemp("saved") / "run"
        result.save(folder, {"recording.rrd": lambda path: recording.write(result, path)})
        return folder

    return call


@pytest.fixture(scope="module")
def folder(save: Callable[..., Path]) -> Path:
    """A run whose second Monte-Carlo run is recorded."""
    return save("recording.run=2", "score.settle_s=0.5")


def plain(table: pa.Table) -> dict[str, list[Any]]:
    return {name: [str(value) for value in column] for name, column in table.to_pydict().items()}


def test_every_number_comes_back(folder: Path) -> None:
    recorded, saved = read(folder / "recording.rrd"), Result.load(folder)
    assert recorded.result.json() == saved.json()
    assert set(recorded.result.tables) == set(TABLES["known"])
    for name in TABLES["known"]:
        assert recorded.result.tables[name].num_rows > 0
        assert plain(recorded.result.tables[name]) == plain(saved.tables[name]), name


def test_the_errors_at_a_time_are_the_latest(folder: Path) -> None:
    (table,) = errors_at(read(folder / "recording.rrd").result, 1.07)
    assert table.caption == "At 1.000 s"
    rows = Result.load(folder).tables["estimates"].to_pylist()
    expected = [row for row in rows if abs(row["time_s"] - 1.0) < 1e-9 and row["px_m"] is not None]
    assert {(row[0].text, row[1].text, row[2].text) for row in table.rows} == {
        (row["object"], row["tracker"], rounded(row["position_error_m"], 2)) for row in expected
    }


def test_the_worst_moments_are_peaks_of_errors_that_count(folder: Path) -> None:
    recorded = recorded_estimates(read(folder).result)
    for tracker, track in recorded.groupby("tracker"):
        moments = worst(recorded, [tracker], 3)
        assert moments[0].position_error_m == track[(track["due"] > 0) & ~track["starting"]]["position_error_m"].max()
        assert all(moment.time_s >= 0.5 for moment in moments), "before that, nothing is scored"
        sizes = [(not moment.starting, moment.position_error_m) for moment in moments]
        assert sizes == sorted(sizes, reverse=True)
        for i, a in enumerate(moments):
            assert all(b.object != a.object or abs(b.time_s - a.time_s) > 1.0 for b in moments[:i])


@pytest.mark.parametrize("head", [b"RRF2\x00\x16\x00\x00", b"RRF1\x00\x16\x00\x00", b"RRF0\x00\x09\x00\x00"])
def test_a_folder_is_read_whatever_its_recording_is(folder: Path, tmp_path: Path, head: bytes) -> None:
    content = head + (folder / "recording.rrd").read_bytes()[len(head) :]
    (tmp_path / "alone.rrd").write_bytes(content)
    with pytest.raises(InputError, match=r"of another version of Rerun|not a Rerun recording"):
        read(tmp_path / "alone.rrd")
    copy = tmp_path / "run"
    shutil.copytree(folder, copy)
    (copy / "recording.rrd").write_bytes(content)
    assert read(copy).recording is None
    assert read(copy).result.json() == read(folder).result.json()


@pytest.mark.parametrize("lost", [5000, 100_000])
def test_a_recording_that_is_cut_off_is_one_message(folder: Path, tmp_path: Path, lost: int) -> None:
    file = tmp_path / "cut.rrd"
    file.write_bytes((folder / "recording.rrd").read_bytes()[:-lost])
    with pytest.raises(InputError, match="cut off"):
        read(file)


def test_what_is_no_recording_is_one_message(tmp_path: Path) -> None:
    for content in (b"", b"RRF", b"RRF2", b"PAR1 and more than that", b"\x89PNG"):
        (tmp_path / "foreign.rrd").write_bytes(content)
        with pytest.raises(InputError, match=r"foreign\.rrd: (not a Rerun recording|this recording is cut off)"):
            read(tmp_path / "foreign.rrd")
    with pytest.raises(InputError, match="no such recording"):
        read(tmp_path / "none.rrd")
    with pytest.raises(InputError, match=r"no result\.json"):
        read(tmp_path)


def test_a_damaged_recording_is_one_message(folder: Path, tmp_path: Path) -> None:
    content = bytearray((folder / "recording.rrd").read_bytes())
    middle = len(content) // 2
    content[middle : middle + 4000] = bytes(4000)
    (tmp_path / "damaged.rrd").write_bytes(content)
    with pytest.raises(InputError, match=r"damaged|cut off"):
        read(tmp_path / "damaged.rrd")


def test_a_recording_of_another_program_is_one_message(tmp_path: Path) -> None:
    other = rr.RecordingStream("other")
    other.save(tmp_path / "other.rrd")
    other.log("a", rr.Scalars(1.0))
    other.disconnect()
    with pytest.raises(InputError, match="holds no run of trackbench"):
        read(tmp_path / "other.rrd")


def test_a_folder_without_a_recording_is_read_from_its_tables(folder: Path, tmp_path: Path) -> None:
    copy = tmp_path / "run"
    shutil.copytree(folder, copy)
    (copy / "recording.rrd").unlink()
    expected = read(folder / "recording.rrd").result
    recorded = read(copy)
    assert worst_moments(recorded.result, Opening(worst=3)) == worst_moments(expected, Opening(worst=3))
    assert recorded.recording is None


def test_a_tracker_that_failed_has_a_cause_and_no_scores(run_tiny: Callable[..., Result], tmp_path: Path) -> None:
    (tmp_path / "stepless.py").write_text("class Stepless:\n    batched = True\n", encoding="utf-8")
    result = run_tiny("trackers.broken.use=stepless:Stepless", folder=tmp_path)
    result.save(tmp_path / "run", {"recording.rrd": lambda path: recording.write(result, path)})
    recorded = read(tmp_path / "run" / "recording.rrd").result
    assert {moment.tracker for moment in worst_moments(recorded, Opening(worst=3))} == {"ekf"}
    failed = recorded["broken"].failed
    assert failed is not None
    assert "step" in failed.cause


def dies(_: Path) -> None:
    os.abort()


def test_a_reader_that_dies_is_one_message(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Rerun's reader panics over some damaged files, and ends its process."""
    monkeypatch.setattr(data, "read_data", dies)
    with pytest.raises(InputError, match=r"cut off or damaged, .*: it cannot be read to its end"):
        read(folder / "recording.rrd")
