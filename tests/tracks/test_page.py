"""The page on traffic without identities does what it says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support.places import DOCS

PAGE = DOCS / "traffic.md"


@pytest.mark.docs_pages
def test_the_page_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(PAGE, tmp_path) == 10
    names = {file.name for file in (tmp_path / "exported").rglob("*") if file.is_file()}
    assert names == {"gt.txt", "seqinfo.ini", "motorway.txt", "events.csv"}
