"""The page on what can be trusted: short, and with the numbers of the code."""

from __future__ import annotations

from tests.support.places import DOCS

from trackbench.base import files
from trackbench.scenario.load import MOST_ERRORS

PAGE = (DOCS / "trust.md").read_text(encoding="utf-8")
TEXT = " ".join(PAGE.split())


def test_the_limits_are_those_of_the_code() -> None:
    assert f"| a scenario's file | {files.SCENARIO >> 20} MiB |" in TEXT
    assert f"| messages about one scenario | {MOST_ERRORS}, " in TEXT
    assert f"| a log as text | {files.LARGE >> 30} GiB |" in TEXT
    assert f"| `result.json` | {files.JSON >> 20} MiB |" in TEXT
