"""The page on trackers of several objects of one's own does what it says."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support.places import DOCS

from trackbench.base.types import Scan, Tracks
from trackbench.subjects.templates.plug_in import new

PAGE = DOCS / "own-multi-tracker.md"


@pytest.mark.docs_pages
def test_the_page_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(PAGE, tmp_path) == 4


def test_what_is_written_needs_nothing_of_trackbench(tmp_path: Path) -> None:
    written = new("multi-tracker", "nearest", tmp_path)[0].read_text(encoding="utf-8")
    assert "trackbench" not in written
    assert max(map(len, written.splitlines())) <= 120


def test_every_part_of_tracks_is_explained() -> None:
    text = PAGE.read_text(encoding="utf-8")
    given, returned = text.split("## What `step` returns")
    returned = returned.partition("## Check it")[0]
    assert re.findall(r"^\| `(\w+)` \|", returned, re.MULTILINE) == list(Tracks._fields)
    assert set(re.findall(r"^\| `(\w+)` \|", given, re.MULTILINE)) < set(Scan._fields)
