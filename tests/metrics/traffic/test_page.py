"""The page on these metrics runs as printed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tests.support.places import DOCS


def test_the_page_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(DOCS / "traffic-metrics.md", tmp_path) == 1
