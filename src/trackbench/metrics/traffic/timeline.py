"""What is kept of the scores of many runs: their sums, so that what a run leaves does not grow with their number."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array
from trackbench.metrics.traffic.events import TrafficEvent
from trackbench.metrics.traffic.run import RunScores

#: Name of these sums among those of metrics.
TIMELINE = "timeline"
#: Events that are kept of each tracker beside those of the recorded run.
MOST_EVENTS = 10_000

Event = tuple[int, TrafficEvent]


@dataclass
class Timeline:
    """The scores of some runs of one tracker in one scene."""

    runs: int = 0
    gospa: Array = field(default_factory=lambda: np.zeros((3, 0)))
    """``(3, T)`` sums over runs of the parts of GOSPA at each instant, m^2."""
    events: list[Event] = field(default_factory=list)
    """With the number of the run: those of the recorded run, and the dearest of the others."""
    recorded: int | None = None
    """The number of the recorded run, if it is one of these."""
    strips: npt.NDArray[np.int8] | None = None
    """``(T, N)`` of the recorded run."""
    reused_ids: int = 0
    """Number of ids that were used again after their track had ended."""

    def add(self, run: int, scores: RunScores, *, recorded: bool) -> None:
        """One more run, by its number."""
        self.runs += 1
        parts = np.stack(scores.gospa)
        self.gospa = parts if not self.gospa.size else self.gospa + parts
        self.events += [(run, event) for event in scores.events]
        if recorded:
            self.recorded, self.strips = run, scores.strips
        if len(self.events) > 2 * MOST_EVENTS:
            self.events = dearest(self.events, self.recorded)


def dearest(events: Sequence[Event], recorded: int | None) -> list[Event]:
    """All events of the recorded run and the dearest of the others, in the order of runs and time."""
    others = [event for event in events if event[0] != recorded]
    if len(others) > MOST_EVENTS:
        others = heapq.nlargest(MOST_EVENTS, others, key=lambda item: (item[1].cost, -item[0], -item[1].instant))
    own = [event for event in events if event[0] == recorded]
    return sorted([*own, *others], key=lambda item: (item[0], item[1].instant))
