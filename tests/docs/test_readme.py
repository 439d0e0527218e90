"""The README does what it says: its commands run as they are printed, and print what it shows but for the numbers."""

from __future__ import annotations

import itertools
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


def rows(page: Path, heading: str) -> dict[str, dict[str, str]]:
    """The first table after a heading: by the first cell of a row, its others by their columns."""
    lines = page.read_text(encoding="utf-8").partition(heading)[2].splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("|"))
    table = [[cell.strip() for cell in line.strip("|").split("|")] for line in itertools.takewhile(bool, lines[first:])]
    return {row[0]: dict(zip(table[0][1:], row[1:], strict=True)) for row in table[2:]}


def test_the_table_of_worlds_is_that_of_the_results() -> None:
    worlds = ("ideal", "human", "typical", "recorded")
    readme = rows(README, "In which world")
    results = rows(ROOT / "results" / "worlds" / "comparison.md", "## Position RMSE, m")
    assert len(readme) == len(worlds)
    for shown, world in zip(readme.values(), worlds, strict=True):
        for tracker, value in shown.items():
            assert float(value) == round(float(results[f"highway-{world}"][tracker].partition(" ")[0].strip("*")), 3)
