"""Trials that are kept in a file: those of another search are not taken for one's own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.subjects.tuning.test_tuning_cli import SCENARIO

from trackbench.subjects.tuning.study import setting_differences

Cli = Callable[..., Any]
PLUGIN = """
import numpy as np


class Last:
    def __init__(self, sigma=1.0):
        self.sigma = sigma

    def step(self, state, scan):
        mean = np.array([*scan.measurement[:2], 0.0, 0.0])
        return state, (mean, OFF * self.sigma * np.eye(4))
"""
TUNE = ("tune", "own.yaml", "--trials", "2", "--storage", "study.db", "--train-runs", "2", "--test-runs", "2")


@pytest.fixture(autouse=True)
def own(tmp_path: Path) -> Path:
    file = tmp_path / "own.yaml"
    file.write_text(SCENARIO.replace("{use: raw}", "{use: 'last:Last'}"), encoding="utf-8")
    (tmp_path / "last.py").write_text(PLUGIN.replace("OFF", "1"), encoding="utf-8")
    return file


def test_a_search_with_another_setting_is_refused_and_says_which(cli: Cli, own: Path) -> None:
    kf = (*TUNE, "--trackers", "kf")
    assert cli(*kf).status == 0
    for arguments, message in (
        (("--range", "acceleration_sigma_mps2=1:2"), "ranges.acceleration_sigma_mps2.low was 0.05 and is 1.0"),
        (("--set", "sensors.lidar.position_sigma_m=0.2"), "scenarios.own.sensors.lidar.position_sigma_m was 0.15"),
        (("--seed", "3"), "seed was 0 and is 3"),
    ):
        done = cli(*kf, *arguments)
        assert (done.status, done.err.count("\n")) == (2, 1)
        assert message in done.err
        assert "give another file" in done.err


def test_a_search_with_another_plug_in_is_refused(cli: Cli, own: Path) -> None:
    last = (*TUNE, "--trackers", "raw", "--range", "options.sigma=0.1:10", "--objective", "consistent_rmse",
            "--in-process")  # fmt: skip
    assert cli(*last).status == 0, cli(*last).err
    own.with_name("last.py").write_text(PLUGIN.replace("OFF", "2"), encoding="utf-8")
    done = cli(*last)
    assert done.status == 2
    assert "scenarios.own.module was" in done.err


def test_a_start_that_gives_something_else_is_told() -> None:
    kept = {"seed": 0, "start": {"own": {"nees": 4.0, "position_rmse": 0.25}}}
    near = {"seed": 0, "start": {"own": {"nees": 4.0 + 1e-12, "position_rmse": 0.25}}}
    assert setting_differences(kept, kept) == setting_differences(kept, near) == ""
    other = {"seed": 0, "start": {"own": {"nees": 4.0, "position_rmse": 0.5}}}
    assert setting_differences(kept, other).startswith("in own the start now gives position RMSE 0.5, and gave 0.25")
    assert setting_differences(kept, {**other, "seed": 1}) == "seed was 0 and is 1"
