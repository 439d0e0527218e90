"""Who takes part in a ranking, and who is a reference beside it."""

from __future__ import annotations

from trackbench.compare import Comparison
from trackbench.compare.comparison import RankedTracker


def competitors(comparison: Comparison) -> list[RankedTracker]:
    """The ranked trackers, best first."""
    return [item for item in comparison.ranking if not item.reference]


def label(item: RankedTracker) -> str:
    """Its name, and whether it is a reference."""
    return f"{item.tracker} (reference)" if item.reference else item.tracker
