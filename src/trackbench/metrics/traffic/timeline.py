"""GOSPA over time summed over many runs, with their costliest events; its size does not grow with the runs."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array
from trackbench.metrics.traffic.events import TrafficEvent
from trackbench.metrics.traffic.run import RunScores

#: Name of the timeline among the sums of metrics.
TIMELINE = "timeline"
#: Largest number of events that are kept of each tracker beside those of the recorded run.
MOST_EVENTS = 10_000

Event = tuple[int, TrafficEvent]


@dataclass
class Timeline:
    """GOSPA over time summed over some runs of one tracker in one scene, with their events."""

    runs: int = 0
    gospa: Array = field(default_factory=lambda: np.zeros((3, 0)))
    """``(3, T)`` the parts of squared GOSPA at each instant (localisation, missed, false), summed over the runs,
    m^2."""
    events: list[Event] = field(default_factory=list)
    """Events with the number of their run: all events of the recorded run, and the costliest of the other runs."""
    recorded: int | None = None
    """Number of the recorded run, whose tracks are kept and shown; None if that run is not among the summed runs."""
    strips: npt.NDArray[np.int8] | None = None
    """``(T, N)`` state of each object in the recorded run, such as waiting, tracked or lost; None without the recorded
    run."""
    recorded_gospa: Array | None = None
    """``(T,)`` squared GOSPA of the recorded run, m^2; None without the recorded run."""
    reused_ids: int = 0
    """Number of track ids that the tracker used again for another track."""

    def add(self, run: int, scores: RunScores, *, recorded: bool) -> None:
        """Add the scores and events of the run numbered ``run``; ``recorded``: whether it is the recorded run."""
        self.runs += 1
        parts = np.stack(scores.gospa)
        self.gospa = parts if not self.gospa.size else self.gospa + parts
        self.events += [(run, event) for event in scores.events]
        if recorded:
            self.recorded, self.strips, self.recorded_gospa = run, scores.strips, scores.gospa.total
        if len(self.events) > 2 * MOST_EVENTS:
            self.events = dearest(self.events, self.recorded)


def dearest(events: Sequence[Event], recorded: int | None) -> list[Event]:
    """Return all events of the recorded run and the costliest of the other runs, in the order of runs and time."""
    others = [event for event in events if event[0] != recorded]
    if len(others) > MOST_EVENTS:
        others = heapq.nlargest(MOST_EVENTS, others, key=lambda item: (item[1].cost, -item[0], -item[1].instant))
    of_recorded = [event for event in events if event[0] == recorded]
    return sorted([*of_recorded, *others], key=lambda item: (item[0], item[1].instant))
