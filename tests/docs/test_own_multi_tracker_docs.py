"""The page on trackers of several objects of one's own does what it says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support.places import DOCS

from trackbench.subjects.templates.plug_in import new

PAGE = DOCS / "own-multi-tracker.md"


@pytest.mark.docs_pages
def test_the_page_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(PAGE, tmp_path) == 4


def test_what_is_written_needs_nothing_of_trackbench(tmp_path: Path) -> None:
    written = new("multi-tracker", "nearest", tmp_path)[0].read_text(encoding="utf-8")
    assert "trackbench" not in written
    assert max(map(len, written.splitlines())) <= 120
