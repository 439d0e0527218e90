"""A result on disk: whole or not there, and the same when it is read again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from trackbench import results
from trackbench.errors import InputError, TrackbenchError
from trackbench.results import Result

SMALL = Result.from_json(
    {"schema_version": 1, "scenario": {"name": "süd"}, "runs": 3, "value": None},
    {
        "steps": pa.table({"time_s": [0.0, 0.1], "error_m": [None, 0.25]}),
        "roads": pa.table({"line": pa.array([], "i8")}),
    },
)


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_round_trip(tmp_path: Path) -> None:
    SMALL.save(tmp_path / "run", {"report.html": lambda path: path.write_bytes(b"<html>")})
    loaded = results.Result.load(tmp_path / "run")
    assert loaded.json() == SMALL.json()
    assert loaded.tables.keys() == SMALL.tables.keys()
    assert all(loaded.tables[name].equals(table) for name, table in SMALL.tables.items())
    assert names(tmp_path) == {"run"}
    assert names(tmp_path / "run") == {"result.json", "report.html", *results.table_files(SMALL)}
    assert "süd" in (tmp_path / "run" / "result.json").read_text(encoding="utf-8")


def test_round_trip_of_a_run(tiny_result: Result, tmp_path: Path) -> None:
    tiny_result.save(tmp_path / "run", {})
    loaded = results.Result.load(tmp_path / "run")
    assert loaded.json() == tiny_result.json()
    assert loaded.tables.keys() == tiny_result.tables.keys()
    for name, table in tiny_result.tables.items():
        assert loaded.tables[name].equals(table), name


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_no_nan_in_json(tmp_path: Path, value: float) -> None:
    with pytest.raises(ValueError, match="Out of range float"):
        Result.from_json({"metrics": [{"value": value}]}, {}).save(tmp_path / "run", {})
    assert names(tmp_path) == set()


def test_anyone_can_read_what_is_written(tmp_path: Path) -> None:
    SMALL.save(tmp_path / "run", {})
    assert (tmp_path / "run").stat().st_mode & 0o777 == 0o755


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), RuntimeError("bug"), KeyboardInterrupt()])
def test_a_writer_that_fails_leaves_the_earlier_result(tmp_path: Path, error: BaseException) -> None:
    def fail(path: Path) -> None:
        path.write_text("half")
        raise error

    SMALL.save(tmp_path / "run", {})
    changed = Result.from_json({**SMALL.json(), "runs": 4}, {})
    with pytest.raises(TrackbenchError if isinstance(error, OSError) else type(error)) as caught:
        changed.save(tmp_path / "run", {"report.html": fail})
    if isinstance(error, OSError):
        assert str(caught.value) == f"cannot write {tmp_path / 'run'}: No space left on device"
    assert names(tmp_path) == {"run"}
    assert results.Result.load(tmp_path / "run").json() == SMALL.json()
    with pytest.raises(type(caught.value)):
        changed.save(tmp_path / "new", {"report.html": fail})
    assert names(tmp_path) == {"run"}


def test_an_earlier_result_comes_back_if_the_new_one_cannot_take_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    SMALL.save(tmp_path / "run", {})
    replace = results.os.replace

    def refuse(source: Any, target: Any) -> None:
        if str(source).endswith(".unfinished") and Path(target).name == "run":
            raise PermissionError(13, "Permission denied")
        replace(source, target)

    monkeypatch.setattr(results.os, "replace", refuse)
    with pytest.raises(TrackbenchError, match=r"cannot write .*/run: Permission denied"):
        Result.from_json({"runs": 4}, {}).save(tmp_path / "run", {})
    monkeypatch.undo()
    assert names(tmp_path) == {"run"}
    assert results.Result.load(tmp_path / "run").json() == SMALL.json()


def test_a_folder_that_is_no_result_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "thesis.txt").write_text("years of work")
    (tmp_path / "file").write_text("more")
    (tmp_path / "empty").mkdir()
    for name in ("notes", "file"):
        with pytest.raises(InputError, match="not the folder of a run: not replaced"):
            results.require_replaceable(tmp_path / name)
        with pytest.raises(InputError, match="not replaced"):
            SMALL.save(tmp_path / name, {})
    assert (tmp_path / "notes" / "thesis.txt").read_text() == "years of work"
    SMALL.save(tmp_path / "empty", {})
    results.require_replaceable(tmp_path / "empty")
    results.require_replaceable(tmp_path / "free")
    assert names(tmp_path) == {"notes", "file", "empty"}


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for attempt in (
        lambda: results.require_writable(tmp_path / "file" / "results"),
        lambda: SMALL.save(tmp_path / "file" / "run", {}),
    ):
        with pytest.raises(InputError, match=r"cannot write to .*/file.*: (Not a directory|File exists)"):
            attempt()
    with pytest.raises(TrackbenchError, match="cannot write"):
        results.write_text(tmp_path / "file" / "comparison.md", "text")


def test_text_is_written_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results.write_text(tmp_path / "comparison.md", "first\n")

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(results.os, "replace", full)
    with pytest.raises(TrackbenchError, match="No space left on device"):
        results.write_text(tmp_path / "comparison.md", "second\n")
    assert (tmp_path / "comparison.md").read_text() == "first\n"
    assert names(tmp_path) == {"comparison.md"}


def damage(folder: Path, file: str, content: bytes) -> None:
    SMALL.save(folder, {})
    (folder / file).write_bytes(content)


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("result.json", b"", "result.json: not a readable result: "),
        ("result.json", b'{"schema_version": 1', "result.json: not a readable result: "),
        ("result.json", b"\xff\xfe", "result.json: not a readable result: "),
        ("result.json", b"[1, 2]", "result.json: schema_version is not 1"),
        ("result.json", b'{"schema_version": 2}', "schema_version is not 1: this result is of another version"),
        ("steps.parquet", b"", "not a readable result: .*steps.parquet|Parquet"),
        ("steps.parquet", b"PAR1 and then nothing PAR1", "not a readable result: "),
    ],
)  # fmt: skip
def test_damaged_results_are_refused(tmp_path: Path, file: str, content: bytes, message: str) -> None:
    damage(tmp_path / "run", file, content)
    with pytest.raises(InputError, match=message) as caught:
        results.Result.load(tmp_path / "run")
    assert str(tmp_path / "run") in str(caught.value)


def test_a_folder_without_a_result(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(InputError, match=r"no result\.json in this folder: it is not the folder of a run"):
            results.Result.load(folder)
