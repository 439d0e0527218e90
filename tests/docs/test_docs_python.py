"""The page and the example on the Python API run as they are."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.support.places import DOCS


def python(code: str, folder: Path) -> str:
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.docs_pages
def test_the_page_runs_from_top_to_bottom(fenced: Callable[[Path], list[Any]], tmp_path: Path) -> None:
    blocks = [block.text for block in fenced(DOCS / "python.md") if block.language == "python"]
    assert blocks
    python("\n".join(blocks), tmp_path)
    written = {file.name for file in tmp_path.iterdir()}
    assert {"cut_in.html", "errors.pdf", "own.png", "results"} <= written


@pytest.mark.docs_pages
def test_the_notebook_runs(tmp_path: Path) -> None:
    printed = python((DOCS / "examples" / "notebook.py").read_text(encoding="utf-8"), tmp_path)
    assert "paired over 50 runs" in printed
    assert "lidar sigma, m: [0.1" in printed
    assert (tmp_path / "velocity.svg").is_file()


@pytest.mark.docs_pages
def test_the_page_on_live_scenarios_runs_as_printed(run_page: Callable[[Path, Path], int], tmp_path: Path) -> None:
    shutil.copy(DOCS / "examples" / "agent_sees_tracks.py", tmp_path)
    assert run_page(DOCS / "live.md", tmp_path) == 3
