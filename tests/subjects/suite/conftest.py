"""An outsider's entry, made once, and a copy of it for each test."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests.support.commands import run_command
from tests.support.places import DOCS

SUITE = "trackbench-road-1"
MINE = """\
name: mine
version: "1.0"
licence: MIT
source: https://example.org/mine
single: {use: "lidar_kalman:LidarKalman", sensors: [roof_lidar]}
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the tracker of the README, its file and its entry."""
    folder = tmp_path_factory.mktemp("outsider")
    shutil.copy(DOCS / "examples" / "lidar_kalman.py", folder)
    (folder / "mine.yaml").write_text(MINE, encoding="utf-8")
    only = ("--only", "drawn-ideal", "--no-recording", "--quiet")
    assert run_command(folder, "suite", "run", SUITE, "mine.yaml", *only) == 0
    return folder


@pytest.fixture
def entry(made: Path, tmp_path: Path) -> Path:
    """Its entry, with its module in the working directory."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    return tmp_path / "entries" / "mine"
