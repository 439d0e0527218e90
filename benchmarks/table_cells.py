"""Cells of the benchmark's tables."""

from __future__ import annotations

from typing import Any


def digits(value: float) -> str:
    """A number to three digits."""
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def met(given: bool | None) -> str:
    """Whether a requirement is met; None: there is none."""
    return {True: "met", False: "missed", None: ""}[given]


def goals(rows: list[dict[str, Any]], of: str = "the fused engine") -> list[str]:
    """What was measured beside what is aimed at, as the lines of a table."""
    return [
        f"| {of} | measured | goal | |",
        "|---|---:|---|---|",
        *(f"| {row['what']} | {digits(row['value'])} | {row['goal']} | {met(row['met'])} |" for row in rows),
    ]
