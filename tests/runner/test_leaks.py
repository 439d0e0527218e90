"""Trackers that know more than their measurements say raise an alarm, and honest ones do not."""

from __future__ import annotations

import io
import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

import trackbench as tb
from trackbench.cli.run import status
from trackbench.report.console import print_summary
from trackbench.report.junit import suite_of_run
from trackbench.report.sentences import answer_of_run
from trackbench.results import Result

Write = Callable[[Path, str], str]

TRACKERS = """
import numpy as np
import trackbench as tb


class ReadsRuns:
    "Finds out which of the runs of a packaged scenario it is in, and answers from their truth."
    batched = True

    def __init__(self, scenario):
        truth = tb.truth(tb.load(scenario))
        self.time, self.states = truth.time, truth.state.reshape(4, len(truth.time), -1)

    def step(self, state, scan):
        states = self.states[:, np.argmin(np.abs(self.time - scan.time))]
        apart = ((states[:2, :, None] - position(scan)[:, None]) ** 2).sum(axis=0)
        apart = np.where(scan.valid, apart, 0.0) + (0.0 if state is None else state)
        return apart, (states[:, apart.argmin(axis=0)], 1e-2 * np.eye(4)[:, :, None] + np.zeros(scan.valid.size))


def position(scan):
    x, y, yaw = scan.sensor_pose
    z = scan.measurement
    if scan.kind == "radar":
        return np.array([x + z[0] * np.cos(yaw + z[1]), y + z[0] * np.sin(yaw + z[1])])
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([x + c * z[0] - s * z[1], y + s * z[0] + c * z[1]])
"""

STEADY: dict[str, Any] = {
    "name": "steady",
    "truth": {
        "source": "scripted", "duration_s": 6, "rate_hz": 10,
        "objects": {"ahead": {"start": {"x": 20, "speed_mps": 5}}},
    },
    "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.3}},
    "monte_carlo": {"runs": 40, "seed": 1},
}  # fmt: skip


@pytest.fixture(scope="module")
def module(tmp_path_factory: pytest.TempPathFactory, write_module: Write) -> tuple[Path, str]:
    """The folder and the name of the module of all trackers."""
    folder = tmp_path_factory.mktemp("leaks")
    return folder, write_module(folder, TRACKERS)


@pytest.fixture
def run(module: tuple[Path, str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    folder, name = module
    monkeypatch.chdir(folder)

    def one(which: Any, cls: str, runs: int | None = None, **options: Any) -> Result:
        entry = {"use": f"{name}:{cls}", "options": options}
        if isinstance(which, dict):
            return tb.run(tb.load({**which, "trackers": {"mine": entry}}, runs=runs))
        return tb.run(tb.load(which, {"trackers.mine": entry}, runs=runs))

    return one


def printed(result: Result) -> str:
    console = Console(width=200, record=True, file=io.StringIO())
    print_summary(result, console)
    return console.export_text()


def test_one_that_beats_the_bound_is_said_first_and_ends_with_status_1(run: Callable[..., Result]) -> None:
    result = run("scripted/own_model", "ReadsRuns", runs=30, scenario="scripted/own_model")
    beats = "beats the Cramér-Rao bound: it knows more than its measurements say"
    assert result.why_unscored(result["mine"]) == f"it {beats}"
    assert printed(result).startswith(f"own_model: mine {beats}; ")
    assert answer_of_run(result).startswith(f"mine {beats}; ")
    assert not result.summary.passed
    assert status([result.updated(expectations=[])]) == 1
    cases = {case.name: case.outcome for case in suite_of_run(result).cases}
    assert cases["mine runs to the end"] == "failed"
    assert not [name for name in result if name != "mine" and result.why_unscored(result[name])]


SPY = """
import json, os, sys
import numpy as np

class Spy:
    def step(self, state, scan):
        told = {"environment": dict(os.environ), "arguments": sys.argv, "scan": repr(scan)}
        with open("told.json", "w") as file:
            json.dump(told, file)
        return None, (np.array([*scan.measurement, 0.0, 0.0]), np.eye(4))
"""


def test_the_process_of_a_tracker_is_told_no_name_or_seed(tmp_path: Path, write_module: Write, trackbench: str) -> None:
    entry = {"mine": {"use": f"{write_module(tmp_path, SPY)}:Spy"}}
    scenario = {**STEADY, "name": "hush_name", "monte_carlo": {"runs": 2, "seed": 918273645}, "trackers": entry}
    (tmp_path / "hush_file.yaml").write_text(json.dumps(scenario), encoding="utf-8")
    command = [trackbench, "run", "hush_file.yaml", "--no-recording"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    told = (tmp_path / "told.json").read_text(encoding="utf-8")
    assert "lidar" in told
    assert not [word for word in ("hush_name", "hush_file", "918273645") if word in told]
