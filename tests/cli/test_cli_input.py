"""Bad input on the command line: one message that says where and what else, exit status 2, nothing written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Cli = Callable[..., Any]

# Arguments, and what the message says.
BAD_USAGE = [
    (["rn", "tiny.yaml"], "No such command 'rn'. Did you mean 'run'?"),
    # Click's words are others in each version.
    (["run", "tiny.yaml", "--worker", "2"], "--workers"),
    (["run"], "Missing argument"),
    (["run", "tiny.yaml", "--runs", "0"], "0 is not in the range x>=1"),
    (["run", "tiny.yaml", "--runs", "many"], "'many' is not a valid integer"),
    (["run", "tiny.yaml", "--scenes", "0"], "0 is not in the range 1<=x<=1000"),
    (["run", "tiny.yaml", "--run", "2"], "'--runs'"),
    (["report", "exm"], "exm: there is no such folder; did you mean 'exam'?"),
    (["inspect", "exa"], "exa: no such recording; did you mean 'exam'?"),
    (["tune", "tiny.yaml", "--trackers", "rw"], "did you mean 'raw'"),
    (["doctor", "loop.yaml#mine"], "loop.yaml: there is no such file; `trackbench list scenarios` shows"),
    (["list", "tracker"], "'tracker' is not one of 'scenarios', 'trackers'"),
    (["list", "motion"], "'functions'. Did you mean 'motion-models'?"),
    (["report", "results", "--format", "tex"], "Did you mean 'latex'?"),
    (["run", "tiny.yaml", "--out", "tiny.yaml"], "'tiny.yaml' is a file"),
    (["snapshot", "empty", "--at", "5"], "Missing argument 'OUT.png'"),
    (["doctor", "own.py"], "own.py: name the class in it: own:Class"),
    (
        ["inspect", "exam"],
        "exam: no result.json in this folder: it is the folder of an examination: open its report.html; `trackbench "
        "view`",
    ),
    (
        ["report", "exam"],
        "exam: no result.json in this folder: it is the folder of an examination: open its report.html",
    ),
    (["report", "tiny.yaml"], "tiny.yaml: not the folder of a run, nor its result.json; a scenario is run first"),
    (["inspect", "tiny.yaml"], "tiny.yaml: not a Rerun recording (.rrd); a scenario is run first: `trackbench run`"),
    (["run", "emty/"], "emty: there is no such file; `trackbench list scenarios` shows those that come with"),
    (["run", "scenaris/"], "scenaris: there is no such file; did you mean 'scenarios'?"),
]

BAD_INPUT = [
    (["tny.yaml"], "tny.yaml: there is no such file; did you mean 'tiny.yaml'?"),
    (["empty"], "empty: there is no scenario file (*.yaml) in this folder"),
    (["tiny.yaml", "--trackers", "ekff"], "--trackers: no tracker 'ekff' in this scenario; did you mean 'ekf'?"),
    (["tiny.yaml", "--trackers", ""], "--trackers: name at least one tracker"),
    (["tiny.yaml", "--out", "tiny.yaml/x"], "--out: cannot write to tiny.yaml/x: Not a directory"),
    (["tiny.yaml", "--out", "/proc"], "--out: cannot write to /proc: "),
    (["tiny.yaml", "tiny.yaml"], "name: 'tiny' is also the name of tiny.yaml; give each scenario its own name"),
    (["tiny.yaml", "--set", "seed=1"], "--set seed=1: seed: unknown key"),
    (["tiny.yaml", "--set", "truth.env=higway-v0"], "--set truth.env=higway-v0: truth.env: unknown highway-env id"),
    (["tiny.yaml", "--seed", "99999999999"], "monte_carlo.seed: "),
    (["tiny.yaml", "--set", "sensors.front.rate_hz=5"], "sensors.front: there is no 'front' in sensors; choose from:"),
    (["tiny.yaml", "--set", "sensors.rader.rate_hz=5"], "there is no 'rader' in sensors; did you mean 'radar'?"),
    (["tiny.yaml", "--set", "trackers.cv.motion=ca"], "there is no 'cv' in trackers; choose from: ekf, raw"),
    (["tiny.yaml", "--set", "monte_carlo.run=5"], "monte_carlo.run: unknown key; did you mean 'runs'?"),
    (["taken.yaml"], "results/taken: it exists and is not the folder of a run, so it is not replaced"),
]

# What is replaced in the scenario, by what, and the message after the file's name.
BAD_SCENARIO = [
    ("highway-v0", "higway-v0", "5: truth.env: unknown highway-env id 'higway-v0'; did you mean 'highway-v0'?"),
    ("lanes_count: 2", "lane_count: 2", "6: truth.config.lane_count: unknown key; did you mean 'lanes_count'?"),
    ("vehicles_count: 4", "vehicles_count: 0", "10: truth.targets: there is no vehicle to track in highway-v0"),
    ("rate_hz: 5", "rate_hz: 0.2, phase_s: 4", "13: sensors.lidar.phase_s: must be a multiple of the truth step"),
    ("use: raw", "use: raw, sensors: [ldar]", "15: trackers.raw.sensors.0: the scenario has no sensor 'ldar'; did you"),
    ("use: raw", "use: rw", "15: trackers.raw.use: no tracker is published as 'rw': did you mean 'raw'?"),
    (
        "use: raw",
        "use: raw, options: {a: 1}",
        "15: trackers.raw.use: 'raw' does not start with these options: got an unexpected keyword argument 'a' (it",
    ),
]


@pytest.mark.parametrize(("arguments", "message"), BAD_USAGE)
def test_wrong_usage(cli: Cli, tiny: Path, tmp_path: Path, arguments: list[str], message: str) -> None:
    for name in ("empty", "exam", "scenarios"):
        (tmp_path / name).mkdir()
    (tmp_path / "exam" / "examination.json").touch()
    (tmp_path / "scenarios" / "a.yaml").touch()
    (tmp_path / "own.py").write_text("class Mine: ...\nclass Other: ...\n", encoding="utf-8")
    done = cli(*arguments)
    assert (done.status, done.out) == (2, "")
    assert message in done.err
    assert "Traceback" not in done.err


@pytest.mark.parametrize(("arguments", "message"), BAD_INPUT)
def test_wrong_input(cli: Cli, tiny: Path, tmp_path: Path, arguments: list[str], message: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "results" / "taken").mkdir(parents=True)
    (tmp_path / "results" / "taken" / "thesis.txt").touch()
    text = tiny.read_text(encoding="utf-8").replace("name: tiny", "name: taken")
    tiny.with_name("taken.yaml").write_text(text, encoding="utf-8")
    done = cli("run", *arguments)
    assert (done.status, done.out) == (2, "")
    assert message in done.err
    assert len(done.err.splitlines()) == 1
    assert [path.name for path in tmp_path.rglob("results/**/*") if path.is_file()] == ["thesis.txt"]


@pytest.mark.parametrize(("old", "new", "message"), BAD_SCENARIO)
def test_wrong_scenario(cli: Cli, tiny: Path, tmp_path: Path, old: str, new: str, message: str) -> None:
    text = tiny.read_text(encoding="utf-8")
    assert text.count(old) == 1
    tiny.write_text(text.replace(old, new), encoding="utf-8")
    done = cli("run", "tiny.yaml")
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith(f"tiny.yaml:{message}"), done.err
    assert len(done.err.splitlines()) == 1
    assert not list((tmp_path / "results").glob("*"))


def test_all_scenarios_are_checked_before_the_first_runs(cli: Cli, tiny: Path, tmp_path: Path) -> None:
    tiny.with_name("z.yaml").write_text("name: z\n", encoding="utf-8")
    done = cli("run", ".")
    assert (done.status, done.out) == (2, "")
    assert all(line.startswith("z.yaml:1: ") for line in done.err.splitlines())
    assert not list((tmp_path / "results").glob("*"))


@pytest.mark.parametrize(
    "command", [["check"], ["run"], ["report"], ["compare"], ["inspect"], ["doctor"], ["audit"], ["view"]]
)
def test_a_name_that_no_file_can_have(cli: Cli, command: list[str]) -> None:
    done = cli(*command, "a" * 5000)
    assert (done.status, done.out) == (2, "")
    assert "cannot write" not in done.err
    assert len(done.err) < 1000


def test_an_output_folder_that_no_folder_can_be(cli: Cli, tiny: Path) -> None:
    done = cli("run", "tiny.yaml", "--out", "a" * 5000)
    assert done.status == 2
    assert "too long" in done.err
