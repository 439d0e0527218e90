"""The page on sensing without identities does what it says, and its figure is what the rules give."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path

from tests.support.places import DOCS


def test_the_page_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(DOCS / "traffic-sensing.md", tmp_path) >= 1


def test_the_figure_is_up_to_date() -> None:
    spec = importlib.util.spec_from_file_location("traffic_sensing_figure", DOCS / "traffic_sensing_figure.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    assert script.picture() == script.FILE.read_text(encoding="utf-8")
