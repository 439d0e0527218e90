"""The page on trackers of several objects does what it says, and compares the methods."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import get_args

from tests.support.places import DOCS

from trackbench.trackers.associate import AssociationMethod

PAGE = DOCS / "traffic-trackers.md"


def test_the_page_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(PAGE, tmp_path) >= 1


def test_the_page_compares_every_method() -> None:
    table = PAGE.read_text(encoding="utf-8").partition("## Which method")[2].partition("## A scan")[0]
    assert re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE) == list(get_args(AssociationMethod))
