"""The README does what it says: its commands run as they are printed, and print what it shows but for the numbers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.support.places import ROOT

from trackbench.results import Result

README = ROOT / "README.md"


@pytest.mark.docs_pages
def test_the_readme_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(README, tmp_path) > 0


def test_the_tracker_of_the_readme_works(
    tmp_path: Path,
    fenced: Callable[[Path], list[Any]],
    write_module: Callable[[Path, str], str],
    run_tiny: Callable[..., Result],
) -> None:
    code = next(block.text for block in fenced(README) if "class LidarKalman" in block.text)
    assert code == (ROOT / "docs" / "examples" / "lidar_kalman.py").read_text(encoding="utf-8")
    sensors = "sensors: [lidar]}"
    start = "initial: {velocity_sigma_mps: 20}"
    theirs = f"trackers.kf={{filter: kf, motion: cv, acceleration_sigma_mps2: 3, {start}, {sensors}"
    mine = f"trackers.mine={{use: '{write_module(tmp_path, code)}:LidarKalman', {sensors}"
    result = run_tiny(mine, theirs, folder=tmp_path)
    assert result["mine"].failed is None
    assert result["mine"].health.diverged_runs == 0
    # The built-in Kalman filter takes the first measurement as its start; this one corrects a wide prior by it.
    assert result["mine"].position_rmse.value == pytest.approx(result["kf"].position_rmse.value, rel=0.01)


def test_the_readme_is_short() -> None:
    assert len(README.read_text(encoding="utf-8").split()) <= 1100
