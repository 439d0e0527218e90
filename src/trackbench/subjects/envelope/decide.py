"""Whether a cell holds, fails or is undecided after a look, and how the error of a map is spent."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from trackbench.base.distributions import t_quantile
from trackbench.metrics.intervals import Interval

State = Literal["holds", "fails", "undecided"]


class Spending(NamedTuple):
    """The error of a map, shared by its cells, trackers and looks."""

    error: float
    """That any cell is decided wrongly, for any tracker."""
    tests: int
    """Cells times trackers."""
    looks: int

    def at(self, look: int, requirements: int) -> float:
        """One-sided level of a requirement at a look, counted from 0, of a tracker with so many requirements."""
        return self.error / self.tests / self.looks / requirements


class Decision(NamedTuple):
    """A requirement in a cell after a look."""

    state: State
    interval: Interval
    low: float | None
    """One-sided bounds of the value; None where there is none."""
    high: float | None


def decide(interval: Interval, limit: float, direction: Literal["below", "above"], level: float) -> Decision:
    """Hold a value against its limit.

    Args:
        interval: the value, with what each independent part adds.
        limit: that it has to be below or above.
        direction: which of these.
        level: one-sided error of each bound.
    """
    parts = len(interval.influence)
    reach = t_quantile(1 - level, parts - 1) * float(np.std(interval.influence, ddof=1)) / parts**0.5
    low, high = interval.value - reach, interval.value + reach
    below, above = ("holds", "fails") if direction == "below" else ("fails", "holds")
    state = below if high < limit else above if low > limit else "undecided"
    return Decision(state, interval, low, high)  # type: ignore[arg-type]
