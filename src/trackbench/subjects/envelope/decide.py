"""How a cell of an envelope is decided: it holds, it fails, or it is undecided.

The probability that any cell of the map is decided wrongly, at any look, is at most one minus the confidence. It is
spent in three steps:

- over cells and trackers: each has the same share (Bonferroni);
- over looks: each has a share that is proportional to the runs that were added since the look before (Lan and DeMets
  1983, "Discrete sequential boundaries for clinical trials", with the uniform spending function);
- over requirements: a cell holds where all of them are shown to hold. If the cell fails, one of them is not met, and
  to show that it is would be the error: each has the whole level. A cell fails where one is shown not to be met. If
  the cell holds, each of them might wrongly be so: they share the level.

A cell really holds or fails. It can be decided wrongly to one side alone, so that either side has the whole level.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

from trackbench.metrics.bounds import bound, unbounded
from trackbench.metrics.intervals import Interval

State = Literal["holds", "fails", "undecided"]
Direction = Literal["below", "above"]


class Spending(NamedTuple):
    """The error of a map, shared by its cells, trackers and looks."""

    error: float
    """That any cell is decided wrongly, for any tracker."""
    tests: int
    """Cells times trackers, as planned."""
    numbers: tuple[int, ...]
    """Of runs, or scenes, of a cell at each look, as planned."""

    def at(self, look: int) -> float:
        """What a look, counted from 0, may spend."""
        added = self.numbers[look] - (self.numbers[look - 1] if look else 0)
        return self.error / self.tests * added / self.numbers[-1]


class CellDecision(NamedTuple):
    """A requirement in a cell after a look."""

    state: State
    interval: Interval
    low: float | None
    """One-sided bounds of the value, each at the level of what it would show; None where there is none."""
    high: float | None

    @property
    def reason(self) -> str:
        """Why there is no bound; empty where there is one."""
        return unbounded(self.interval)


def decide(interval: Interval, limit: float, direction: Direction, level: float, requirements: int = 1) -> CellDecision:
    """Hold a value against its limit.

    Args:
        interval: of the runs or scenes so far; of ``better_than`` that of the difference, whose limit is zero.
        limit: that it has to be below or above.
        direction: which of these.
        level: what the look may spend.
        requirements: of the cell.
    """
    below = direction == "below"
    low = bound(interval, level / requirements if below else level, "lower")
    high = bound(interval, level if below else level / requirements, "upper")
    state: State = "undecided"
    if high is not None and high < limit:
        state = "holds" if below else "fails"
    elif low is not None and low > limit:
        state = "fails" if below else "holds"
    return CellDecision(state, interval, low, high)


def together(states: Iterable[State]) -> State:
    """The state of a cell from those of all its requirements."""
    distinct = set(states)
    return "fails" if "fails" in distinct else "holds" if distinct == {"holds"} else "undecided"


def changed(before: State, after: State, difference: Interval, direction: Direction, level: float) -> bool:
    """Whether a cell went from holds to fails, and the value is shown to be worse.

    Where nothing changed, one of the two states is wrong: what the two maps spend bounds how often that is.

    Args:
        before: the state in one map.
        after: that in the other.
        difference: the value after minus the value before, see :func:`trackbench.metrics.bounds.difference`.
        direction: where the value has to be.
        level: what one cell may spend.
    """
    return (before, after) == ("holds", "fails") and decide(difference, 0.0, direction, level).state == "fails"
