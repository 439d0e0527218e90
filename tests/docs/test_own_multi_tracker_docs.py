"""The page on trackers of several objects of one's own does what it says."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.support.places import DOCS

from trackbench.base.types import Scan, Tracks
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


def test_every_part_of_tracks_is_explained() -> None:
    text = PAGE.read_text(encoding="utf-8")
    given, returned = text.split("## What `step` returns")
    returned = returned.partition("## Check it")[0]
    assert re.findall(r"^\| `(\w+)` \|", returned, re.MULTILINE) == list(Tracks._fields)
    assert set(re.findall(r"^\| `(\w+)` \|", given, re.MULTILINE)) < set(Scan._fields)
