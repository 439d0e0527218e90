"""A result on disk: whole or not there, and the same when it is read again."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from trackbench import results
from trackbench.base.errors import InputError, OutputError, TrackbenchError
from trackbench.results import SCHEMA_VERSION, MetricValue, Result, by_value, folder, json_text

SMALL = Result.from_json(
    {
        "schema_version": SCHEMA_VERSION,
        "scenario": {"name": "süd", "description": "", "file": "süd.yaml", "text": "", "overrides": []},
        "seed": 7,
        "runs": 3,
        "versions": {"trackbench": "0.1.0"},
        "command": "trackbench run süd.yaml",
        "fingerprints": ["0123456789abcdef"] * 3,
        "truth": {
            "source": "scripted",
            "objects": ["v1"],
            "steps": 2,
            "dt": 0.1,
            "duration_s": 0.1,
            "audit": {},
            "cached": False,
        },
        "sensors": {},
        "reference": {
            "kind": "reference",
            "acceleration_sigma_mps2": 1,
            "acceleration_from": "truth",
        },
        "score": {
            "settle_s": 0,
            "min_coverage": 0.9,
            "from_s": 0.0,
            "to_s": 1.0,
            "margin": {"percent": 1.0, "position_m": 0.005, "velocity_mps": 0.02, "course_deg": 0.05},
        },
        "recorded_run": 0,
        "trackers": [
            {
                "name": "ekf",
                "describe": "ekf, cv",
                "failed": None,
                "metrics": {
                    "position_rmse": {"value": 0.5, "unit": "m", "ci95": [0.4, 0.6]},
                    "rmse.px": {"value": None, "unit": "m", "reason": "none"},
                    "nees": {"mean": 4.1, "unit": "1", "dof": 4, "verdict": "consistent"},
                },
                "health": {"diverged_runs": 0, "repaired_covariances": 0, "repaired_runs": 0},
            }
        ],
        "ranking": ["ekf"],
        "expectations": [],
        "passed": True,
        "artifacts": {},
    },
    {
        "steps": pa.table(
            {
                "tracker": ["ekf"] * 2,
                **{name: [0.0, 0.1] for name in ("time_s", "position_rmse_m")},
                "own": [None, 0.25],
            }
        ),
        "roads": pa.table({name: pa.array([], "f8") for name in ("line", "x_m", "y_m")}),
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
    assert names(tmp_path / "run") == {"result.json", "report.html", *(f"{name}.parquet" for name in SMALL.tables)}
    assert "süd" in (tmp_path / "run" / "result.json").read_text(encoding="utf-8")


def test_round_trip_of_a_run(tiny_result: Result, tmp_path: Path) -> None:
    tiny_result.save(tmp_path / "run", {})
    loaded = results.Result.load(tmp_path / "run")
    assert loaded.json() == tiny_result.json()
    assert loaded.tables.keys() == tiny_result.tables.keys()
    for name, table in tiny_result.tables.items():
        assert loaded.tables[name].equals(table), name


def test_metrics_by_attribute_and_by_path() -> None:
    ekf = SMALL["ekf"]
    assert (ekf.position_rmse.value, ekf.position_rmse.ci95) == (0.5, (0.4, 0.6))
    assert ekf.metrics["rmse.px"].reason == "none"
    assert (ekf.nees.mean, ekf.nees.verdict) == (4.1, "consistent")
    assert SMALL.json()["trackers"][0]["metrics"]["rmse.px"] == {"value": None, "unit": "m", "reason": "none"}
    with pytest.raises(AttributeError, match="no attribute or metric 'gospa'"):
        _ = ekf.gospa
    with pytest.raises(InputError, match="no tracker 'ekg' in this result; did you mean 'ekf'"):
        _ = SMALL["ekg"]


def test_the_fingerprint_of_all_runs_is_that_of_each() -> None:
    one, other = (SMALL.updated(fingerprints=[each] * 3).summary.fingerprint for each in ("a" * 16, "b" * 16))
    assert one != other
    assert len(one) == 16
    assert one == SMALL.updated(fingerprints=["a" * 16] * 3).summary.fingerprint


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_no_nan_in_json(value: float) -> None:
    with pytest.raises(ValidationError, match="finite number"):
        MetricValue(value=value, unit="m")
    with pytest.raises(ValueError, match="Out of range float"):
        json_text({"value": value})


def test_anyone_can_read_what_is_written(tmp_path: Path) -> None:
    SMALL.save(tmp_path / "run", {})
    assert (tmp_path / "run").stat().st_mode & 0o777 == 0o755


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), RuntimeError("bug"), KeyboardInterrupt()])
def test_a_writer_that_fails_leaves_the_earlier_result(tmp_path: Path, error: BaseException) -> None:
    def fail(path: Path) -> None:
        path.write_text("half")
        raise error

    SMALL.save(tmp_path / "run", {})
    changed = SMALL.updated(runs=4)
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
    replace = folder.os.replace

    def refuse(source: Any, target: Any) -> None:
        if str(source).endswith(".unfinished") and Path(target).name == "run":
            raise PermissionError(13, "Permission denied")
        replace(source, target)

    monkeypatch.setattr(folder.os, "replace", refuse)
    with pytest.raises(TrackbenchError, match=r"cannot write .*/run: Permission denied"):
        SMALL.updated(runs=4).save(tmp_path / "run", {})
    monkeypatch.undo()
    assert names(tmp_path) == {"run"}
    assert results.Result.load(tmp_path / "run").json() == SMALL.json()


def test_a_folder_that_is_no_result_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "thesis.txt").write_text("years of work")
    (tmp_path / "file").write_text("more")
    (tmp_path / "empty").mkdir()
    for name in ("notes", "file"):
        with pytest.raises(InputError, match="not the folder of a run, so it is not replaced"):
            results.require_replaceable(tmp_path / name)
        with pytest.raises(OutputError, match=r"cannot write .*: it exists and is not .* not replaced"):
            SMALL.save(tmp_path / name, {})
    assert (tmp_path / "notes" / "thesis.txt").read_text() == "years of work"
    SMALL.save(tmp_path / "empty", {})
    results.require_replaceable(tmp_path / "empty")
    results.require_replaceable(tmp_path / "free")
    assert names(tmp_path) == {"notes", "file", "empty"}


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    why = r"cannot write to .*/file.*: (Not a directory|File exists)"
    with pytest.raises(InputError, match=why):
        results.require_writable(tmp_path / "file" / "results")
    with pytest.raises(OutputError, match=why):
        SMALL.save(tmp_path / "file" / "run", {})
    with pytest.raises(TrackbenchError, match="cannot write"):
        results.write_bytes(tmp_path / "file" / "comparison.md", b"text")


def test_text_is_written_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results.write_bytes(tmp_path / "comparison.md", b"first\n")

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(folder.os, "replace", full)
    with pytest.raises(TrackbenchError, match="No space left on device"):
        results.write_bytes(tmp_path / "comparison.md", b"second\n")
    assert (tmp_path / "comparison.md").read_text() == "first\n"
    assert names(tmp_path) == {"comparison.md"}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "result.json: not a readable result: "),
        (b'{"schema_version": 1', "result.json: not a readable result: "),
        (b"\xff\xfe", "result.json: not a readable result: "),
        (b"[1, 2]", "result.json: not a result"),
        (b"[" * 100_000, "result.json: not a readable result: "),
        (b'{"schema_version": 1}', "schema_version is not 7: this result was written by another version"),
        (f'{{"schema_version": {SCHEMA_VERSION}}}'.encode(), "not a result: scenario: Field required"),
    ],
)
def test_damaged_results_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    SMALL.save(tmp_path / "run", {})
    (tmp_path / "run" / "result.json").write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        results.Result.load(tmp_path / "run")
    assert str(tmp_path / "run") in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"PAR1 and then nothing PAR1", None])
def test_damaged_tables_are_refused_when_they_are_read(tmp_path: Path, content: bytes | None) -> None:
    SMALL.save(tmp_path / "run", {})
    file = tmp_path / "run" / "steps.parquet"
    file.unlink() if content is None else file.write_bytes(content)
    loaded = results.Result.load(tmp_path / "run")
    assert loaded.json() == SMALL.json()
    with pytest.raises(
        InputError, match=r"no steps\.parquet" if content is None else "not the table that this run wrote"
    ) as caught:
        _ = loaded.tables.steps
    assert str(tmp_path / "run") in str(caught.value)


def test_a_folder_without_a_result(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no result\.json in this folder: it is not the folder of a run"):
        results.Result.load(tmp_path)
    with pytest.raises(InputError, match="there is no such folder"):
        results.Result.load(tmp_path / "nowhere")


def test_a_table_that_was_changed_is_refused(tiny_result: Result, tmp_path: Path) -> None:
    tiny_result.save(tmp_path / "run", {})
    file = tmp_path / "run" / "estimates.parquet"
    pq.write_table(pq.read_table(file).slice(1), file)
    with pytest.raises(InputError, match="not the table that this run wrote") as caught:
        _ = results.Result.load(tmp_path / "run").tables.estimates
    assert str(caught.value).startswith(str(file))


def test_values_that_differ_by_rounding_are_in_the_order_of_the_scenario() -> None:
    rest = {"far": 1.0 + 1e-6, "near": 0.5, "failed": math.inf, "lost": math.inf}
    for kf, ekf in ((1.0, 1.0 + 4e-16), (1.0 + 4e-16, 1.0), (1.0, 1.0)):
        assert by_value({"kf": kf, "ekf": ekf, **rest}) == ["near", "kf", "ekf", "far", "failed", "lost"]
        assert by_value({"ekf": ekf, "kf": kf, **rest}) == ["near", "ekf", "kf", "far", "failed", "lost"]
    assert by_value({}) == []
