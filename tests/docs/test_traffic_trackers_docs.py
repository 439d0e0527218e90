"""The page on trackers of several objects does what it says, and says what each option does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tests.support.places import DOCS

from trackbench.trackers.associate import METHODS, AssociateConfig

PAGE = DOCS / "traffic-trackers.md"


def test_the_page_runs_as_printed(tmp_path: Path, run_page: Callable[[Path, Path], int]) -> None:
    assert run_page(PAGE, tmp_path) >= 1


def test_the_page_knows_every_option() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert not [name for name in AssociateConfig.model_fields if f"`{name}" not in text and f"{name}:" not in text]
    assert set(METHODS) <= set(AssociateConfig.model_fields)
