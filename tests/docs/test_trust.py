"""The page on what can be trusted: short, and with the numbers of the code."""

from __future__ import annotations

from tests.support.places import DOCS

from trackbench.scenario.load import MOST_ERRORS

PAGE = (DOCS / "trust.md").read_text(encoding="utf-8")
TEXT = " ".join(PAGE.split())


def test_the_limits_are_those_of_the_code() -> None:
    assert f"| messages about one scenario | {MOST_ERRORS}, " in TEXT
