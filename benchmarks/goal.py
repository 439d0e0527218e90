"""What is aimed at, beside what was measured."""

from __future__ import annotations

from typing import Any


def at_most(what: str, value: float, goal: float) -> dict[str, Any]:
    """As a row of the tables."""
    return {"what": what, "value": value, "goal": f"at most {goal:g}", "met": value <= goal}


def at_least(what: str, value: float, goal: float) -> dict[str, Any]:
    """As a row of the tables."""
    return {"what": what, "value": value, "goal": f"at least {goal:g}", "met": value >= goal}
