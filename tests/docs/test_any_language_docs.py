"""The page on trackers in other languages does what it says."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.support.places import DOCS

from trackbench.driving import frames
from trackbench.subjects.templates.plug_in import new

PAGE = DOCS / "any-language.md"


@pytest.mark.docs_pages
@pytest.mark.skipif(not shutil.which("g++"), reason="there is no compiler")
def test_the_page_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(PAGE, tmp_path) == 7
    assert (tmp_path / "my_tracks").exists()


def test_the_program_in_python_is_short_and_needs_nothing_of_trackbench(tmp_path: Path) -> None:
    written = new("tracker", "kalman_program", tmp_path, language="python-program")[0].read_text(encoding="utf-8")
    assert "trackbench" not in written
    assert len(written.splitlines()) <= 30


def test_the_version_is_that_of_the_code() -> None:
    assert re.findall(r"^## The protocol, version (\d+)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE) == [
        str(frames.VERSION)
    ]
