"""The command line, as its user meets it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from trackbench.results.folder import sha256

Cli = Callable[..., Any]

TABLES = {
    "steps",
    "nis",
    "runs",
    "differences",
    "truth",
    "measurements",
    "estimates",
    "recorded_nis",
    "roads",
}


def result(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "result.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)


def without_times(summary: dict[str, Any]) -> dict[str, Any]:
    """The result without what may differ between two runs of the same."""
    summary = json.loads(json.dumps(summary))
    for tracker in summary["trackers"]:
        tracker["metrics"].pop("step_time")
    return {**summary, "command": "", "provenance": None, "truth": {**summary["truth"], "cached": None}}


def test_a_run_leaves_a_result_a_report_and_a_recording(cli: Cli, tiny: Path) -> None:
    done = cli("run", "tiny.yaml")
    assert done.status == 0
    assert done.err == ""
    assert "\x1b" not in done.out
    lines = done.out.splitlines()
    assert "4 noise draws of ONE scene (2 vehicles, 2.0 s), seed 7" in lines
    (head,) = (number for number, line in enumerate(lines) if line.startswith("tracker "))
    assert [line.split()[0] for line in lines[head + 1 : head + 3]] == ["ekf", "raw"]
    assert "results/tiny/: result.json, report.html, report.md, recording.rrd" in lines
    # A command is not broken in two, so that it can be copied.
    assert max(len(line) for line in lines if " trackbench " not in line) <= 80
    folder = tiny.parent / "results" / "tiny"
    summary = result(folder)
    files = {"result.json", *summary["artifacts"].values()}
    assert files == {
        "result.json",
        "report.html",
        "report.md",
        "recording.rrd",
        *(f"{name}.parquet" for name in TABLES),
    }
    assert {path.name for path in folder.iterdir()} == files
    assert summary["command"] == "trackbench run tiny.yaml"
    assert summary["scenario"]["text"] == tiny.read_text(encoding="utf-8")
    assert [path.name for path in (tiny.parent / "results").iterdir()] == ["tiny"]


def test_only_the_result_is_on_stdout_with_json(tiny: Path, tmp_path: Path, trackbench: str) -> None:
    # A cache of its own: pygame says hello where highway-env is imported to simulate.
    environment = {**os.environ, "TRACKBENCH_CACHE": str(tmp_path / "cache"), "PYTHONUNBUFFERED": ""}
    code = "class T:\n    def step(self, state, scan):\n        print('noise')\n        return None, None\n"
    (tmp_path / "talks.py").write_text(code, encoding="utf-8")
    done = subprocess.run(
        [trackbench, "run", "tiny.yaml", "--json", "--no-recording", "--set", "trackers.talks.use=talks:T"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 3, done.stderr
    stored = result(tmp_path / "results" / "tiny")
    # Only the file has the digests of the tables beside it.
    digests = stored.pop("tables")
    assert json.loads(done.stdout) == stored
    folder = tmp_path / "results" / "tiny"
    assert digests == {name: sha256(folder / f"{name}.parquet") for name in TABLES}
    # What it prints is capped, which is said.
    lines = set(done.stderr.splitlines())
    assert "noise" in lines
    assert all(line == "noise" or line.startswith("talks:T") for line in lines)


def test_python_m_trackbench_is_the_console_script(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "trackbench", "run", "missing.yaml"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert "missing.yaml" in done.stderr


def test_json_of_several_scenarios_is_a_list(cli: Cli, tiny: Path) -> None:
    tiny.with_name("two.yaml").write_text(tiny.read_text(encoding="utf-8").replace("name: tiny", "name: two"))
    done = cli("run", ".", "--json", "--no-recording")
    assert done.status == 0
    assert [item["scenario"]["name"] for item in json.loads(done.out)] == ["tiny", "two"]
    assert done.err == ""


@pytest.mark.parametrize(
    ("limit", "status", "word"),
    [
        ("below: 100", 0, "expectation of the scenario is met"),
        ("above: 100", 1, "wanted above 100"),
        ("better_than: raw", 0, "is met"),
    ],
)
def test_the_exit_status_says_whether_the_expectations_are_met(
    cli: Cli, tiny: Path, limit: str, status: int, word: str
) -> None:
    done = cli(
        "run", "tiny.yaml", "--no-recording", "--set", f"expect=[{{tracker: ekf, metric: position_rmse, {limit}}}]"
    )
    assert done.status == status
    assert word in done.out
    assert result(tiny.parent / "results" / "tiny")["passed"] is (status == 0)


def test_options_change_the_run(cli: Cli, tiny: Path, tmp_path: Path) -> None:
    setting = "sensors.radar.range_sigma_m=0.5"
    options = [
        "--runs",
        "3",
        "--seed",
        "9",
        "--trackers",
        "raw",
        "--set",
        setting,
        "--out",
        "deep/er",
        "--no-recording",
    ]
    assert cli("run", "tiny.yaml", *options).status == 0
    summary = result(tmp_path / "deep" / "er" / "tiny")
    assert (summary["runs"], summary["seed"]) == (3, 9)
    assert [tracker["name"] for tracker in summary["trackers"]] == ["raw"]
    assert summary["scenario"]["overrides"] == [setting, "monte_carlo.runs=3", "monte_carlo.seed=9"]
    assert "recording" not in summary["artifacts"]
    assert not (tmp_path / "deep" / "er" / "tiny" / "recording.rrd").exists()
    # The command that the result states gives the same measurements again.
    again = summary["command"].split()[1:]
    assert cli(*again, "--no-recording").status == 0
    assert result(tmp_path / "results" / "tiny")["fingerprints"] == summary["fingerprints"]


def test_expectations_of_trackers_left_out_are_not_judged(cli: Cli, tiny: Path) -> None:
    expect = (
        "expect=[{tracker: ekf, metric: position_rmse, better_than: raw}, {tracker: ekf, metric: coverage, above: 0}]"
    )
    assert cli("run", "tiny.yaml", "--no-recording", "--trackers", "ekf", "--set", expect).status == 0
    summary = result(tiny.parent / "results" / "tiny")
    assert [item["text"] for item in summary["expectations"]] == ["ekf coverage above 0"]


def test_two_workers_give_the_same_result_bit_for_bit(cli: Cli, tiny: Path, tmp_path: Path) -> None:
    runs = ["run", "tiny.yaml", "--no-recording", "--runs", "2500"]
    assert cli(*runs, "--out", "one").status == 0
    assert cli(*runs, "--out", "two", "--workers", "2").status == 0
    one, two = tmp_path / "one" / "tiny", tmp_path / "two" / "tiny"
    assert without_times(result(one)) == without_times(result(two))
    for name in TABLES:
        assert pq.read_table(one / f"{name}.parquet").equals(pq.read_table(two / f"{name}.parquet")), name


def test_a_folder_is_run_and_compared(cli: Cli, tiny: Path, tmp_path: Path) -> None:
    scenarios = tmp_path / "scenarios"
    scenarios.mkdir()
    for name in ("one", "two"):
        text = tiny.read_text(encoding="utf-8").replace("name: tiny", f"name: {name}")
        (scenarios / f"{name}.yaml").write_text(text, encoding="utf-8")
    done = cli("run", "scenarios", "--no-recording")
    assert done.status == 0
    assert done.out.splitlines()[-1] == "Comparison of 2 scenarios: results/comparison.md"
    found = {path.name for path in (tmp_path / "results").iterdir()}
    assert found >= {"one", "two", "comparison.md", "comparison.json"}
    assert not [name for name in found if name.startswith(".")]
    assert json.loads((tmp_path / "results" / "comparison.json").read_text(encoding="utf-8"))
    assert "ekf" in (tmp_path / "results" / "comparison.md").read_text(encoding="utf-8")


def test_lists(cli: Cli, tiny: Path) -> None:
    expected = {
        "trackers": "ukf",
        "filters": "ckf",
        "motion-models": "ctrv",
        "sensors": "lidar",
        "metrics": "nees.verdict",
        "envs": "roundabout-v1",
        "checks": "azimuth_wrapping",
    }
    for what, name in expected.items():
        done = cli("list", what)
        assert (done.status, done.err) == (0, "")
        assert name in [line.split()[0] for line in done.out.splitlines()]


def test_check_says_what_a_recording_implies(cli: Cli) -> None:
    first, note = cli("check", "recorded/i80").out.splitlines()
    assert first == "recorded/i80: ok"
    assert "200 vehicles at 10 Hz" in note
    assert "smoothing took 0.065 m" in note


def test_check_and_schema(cli: Cli, tiny: Path) -> None:
    assert cli("check", "tiny.yaml").out == "tiny.yaml: ok\n"
    assert json.loads(cli("schema").out)["properties"]["name"]
    assert not (tiny.parent / "results").exists()


def test_a_run_with_a_plug_in_writes_its_recording(tiny: Path, tmp_path: Path, trackbench: str) -> None:
    (tmp_path / "beside.py").write_text("from trackbench.models.motion.cv import ConstantVelocity as Own\n")
    tiny.write_text(tiny.read_text().replace("motion: cv", 'motion: "beside:Own"'))
    done = subprocess.run([trackbench, "run", "tiny.yaml"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "results" / "tiny" / "recording.rrd").is_file()


@pytest.mark.parametrize("command", ["schema", "list metrics", "run tiny.yaml --no-recording", "--help"])
def test_a_reader_that_goes_away_is_no_error(tiny: Path, tmp_path: Path, trackbench: str, command: str) -> None:
    pipe = f"set -o pipefail; {trackbench} {command} | true"
    done = subprocess.run(["bash", "-c", pipe], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert done.returncode in (0, 141)
