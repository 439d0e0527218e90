"""Where the system lacks what a process of a tracker needs, built-in trackers run, and others run in the bench's."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from tests.support.places import ROOT

import trackbench as tb

SCENARIO = """\
name: mine
truth: {source: scripted, duration_s: 1, rate_hz: 10, objects: {car: {start: {x: 20, y: 5, speed_mps: 10}}}}
sensors: {lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.15}}
trackers: {ekf: {filter: ekf, motion: cv, acceleration_sigma_mps2: 1}, mine: {use: "mine:Mine"}}
score: {settle_s: 0}
monte_carlo: {runs: 2, seed: 7}
"""
MINE = """\
import os
import numpy as np

class Mine:
    def step(self, state, scan):
        with open("process", "w") as file:
            file.write(str(os.getpid()))
        return None, (np.array([20.0, 5.0, 10.0, 0.0]), np.eye(4))
"""
APART = "mine: Windows has no os.fork, so that this tracker runs in the process of the bench"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "mine.yaml").write_text(SCENARIO)
    (tmp_path / "mine.py").write_text(MINE)
    return tmp_path


def elsewhere(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """What a command does where the system has nothing of what Windows lacks."""
    command = [sys.executable, str(ROOT / "tests" / "support" / "other_system.py"), *arguments]
    environment = os.environ | {"TRACKBENCH_CACHE": str(folder / "cache")}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def numbers(result: dict[str, Any]) -> list[Any]:
    """The errors of every tracker."""
    return [tracker["metrics"]["position_rmse"] for tracker in result["trackers"]]


def test_check_says_in_one_line_that_a_tracker_is_not_kept_apart(folder: Path) -> None:
    done = elsewhere(folder, "check", "mine.yaml")
    assert done.returncode == 0, done.stderr
    first, *notes = done.stdout.splitlines()
    assert first == "mine.yaml: ok"
    assert len(notes) == 1
    assert notes[0].strip().startswith(APART)
    assert "without limits of time and memory" in notes[0]


def test_a_run_warns_and_gives_the_numbers_that_processes_give(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done = elsewhere(folder, "run", "mine.yaml", "--no-recording", "--json")
    assert done.returncode == 0, done.stderr
    assert done.stderr.startswith(APART)
    assert done.stderr.count(APART) == 1
    monkeypatch.chdir(folder)
    assert numbers(json.loads(done.stdout)) == numbers(tb.run("mine.yaml").json())


@pytest.mark.parametrize("arguments", [(), ("--workers", "2")], ids=["alone", "workers"])
def test_a_built_in_scenario_runs_and_says_nothing(folder: Path, arguments: tuple[str, ...]) -> None:
    short = ("--runs", "2", "--set", "truth.duration_s=2", "--set", "expect=[]", "--trackers", "ekf_cv,imm_three")
    done = elsewhere(folder, "run", "highway", *short, *arguments)
    assert (done.returncode, done.stderr) == (0, "")
    assert (folder / "results" / "highway" / "recording.rrd").stat().st_size > 0
