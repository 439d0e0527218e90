"""The README does what it says: its commands run as they are printed, and print what it shows but for the numbers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.support.places import ROOT

from trackbench.results import Result
from trackbench.testing import check_tracker

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
    code = next(block.text for block in fenced(README) if "class AlphaBeta" in block.text)
    assert len(code.splitlines()) <= 30
    assert code == (ROOT / "docs" / "examples" / "alpha_beta.py").read_text(encoding="utf-8")
    namespace: dict[str, Any] = {}
    exec(code, namespace)
    check_tracker(namespace["AlphaBeta"], alpha=0.3)
    use = f"trackers.mine={{use: '{write_module(tmp_path, code)}:AlphaBeta', options: {{alpha: 0.3}}}}"
    result = run_tiny(use, folder=tmp_path)
    mine = next(entry for entry in result.json()["trackers"] if entry["name"] == "mine")
    assert mine["failed"] is None
    assert mine["health"]["diverged_runs"] == 0
