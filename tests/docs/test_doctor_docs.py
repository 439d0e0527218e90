"""The page on the doctor says and does what the doctor does."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.support.places import DOCS, ROOT

PAGE = DOCS / "doctor.md"

Fenced = Callable[[Path], list[Any]]


@pytest.mark.docs_pages
def test_the_case_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    shutil.copy(DOCS / "examples" / "sensor_fusion_student.py", tmp_path)
    assert run_page(PAGE, tmp_path) == 5
    assert (tmp_path / "results" / "doctor" / "sensor_fusion_student_Tracker" / "report.html").exists()


def test_the_readme_shows_what_a_student_sees(fenced: Fenced) -> None:
    shown = next(block.text for block in fenced(ROOT / "README.md") if "an angle is not wrapped" in block.text)
    page = (DOCS / "start" / "student.md").read_text(encoding="utf-8")
    assert all(line in page for line in shown.splitlines())
