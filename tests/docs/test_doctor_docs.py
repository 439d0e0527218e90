"""The page on the doctor says and does what the doctor does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.support.places import DOCS, ROOT

PAGE = DOCS / "doctor.md"

Fenced = Callable[[Path], list[Any]]


@pytest.mark.docs_pages
def test_the_case_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(PAGE, tmp_path) == 10
    assert (tmp_path / "results" / "doctor" / "sensor_fusion_student_Tracker" / "report.html").exists()


def test_the_page_shows_the_files(fenced: Fenced) -> None:
    shown = {block.note.removeprefix("file: "): block.text for block in fenced(PAGE) if block.note.startswith("file: ")}
    examples = (DOCS / "examples").glob("sensor_fusion*")
    assert shown == {path.name: path.read_text(encoding="utf-8") for path in examples if path.is_file()}


def test_the_readme_shows_what_a_student_sees(fenced: Fenced) -> None:
    shown = next(block.text for block in fenced(ROOT / "README.md") if "an angle is not wrapped" in block.text)
    page = (DOCS / "start" / "student.md").read_text(encoding="utf-8")
    assert all(line in page for line in shown.splitlines())
