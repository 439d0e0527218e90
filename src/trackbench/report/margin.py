"""A margin in words."""

from __future__ import annotations

from trackbench.results.score_summary import MarginSummary


def margin_words(margin: MarginSummary, unit: str) -> str:
    """ "1 % or 5 mm", of which the larger counts."""
    absolute = margin.absolute(unit)
    parts = [f"{margin.percent:g} %"] if margin.percent or not absolute else []
    if absolute:
        parts.append(f"{1000 * absolute:g} mm" if unit == "m" and absolute < 1 else f"{absolute:g} {unit}")
    return " or ".join(parts)
