"""The page on trackers of several objects of one's own does what it says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.support.places import DOCS

from trackbench.subjects.templates.plug_in import new

PAGE = DOCS / "own-multi-tracker.md"


@pytest.mark.docs_pages
def test_the_page_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(PAGE, tmp_path) == 5


def test_the_page_shows_what_is_written(tmp_path: Path, fenced: Callable[[Path], list[Any]]) -> None:
    shown = next(block.text for block in fenced(PAGE) if block.note == "file: nearest.py")
    written = new("multi-tracker", "nearest", tmp_path)[0].read_text(encoding="utf-8")
    assert shown == written
    assert "trackbench" not in shown
    assert max(map(len, shown.splitlines())) <= 120
