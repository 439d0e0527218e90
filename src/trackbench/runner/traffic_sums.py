"""What is kept of the scores of many runs: their sums, so that what a run leaves does not grow with their number."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array
from trackbench.metrics.intervals import Interval
from trackbench.metrics.traffic import TRACK_METRICS, RunRatio, RunScores
from trackbench.metrics.traffic.events import TrafficEvent
from trackbench.metrics.traffic.track_quality import ExistenceBins
from trackbench.metrics.traffic.without_truth import DETECTION_METRICS, NO_TRUTH, OF_PREDICTIONS, OF_USE
from trackbench.results import MetricValue

#: Every metric that a run may have.
PATHS = tuple(dict.fromkeys([*TRACK_METRICS, *DETECTION_METRICS]))
#: Events that are kept of each tracker beside those of the recorded run.
MOST_EVENTS = 10_000
NOT_ASKED = "only built-in trackers are asked what they predict"
#: Why there is no value where nothing had to be tracked: every number would be as good as perfect.
NOTHING_DUE = "no object was ever due: none came into a sensor's view (fov_deg, max_range_m, mount)"
#: What a tracker that says nothing of it has in the place of a value.
NOT_SAID = "the tracker does not say which detections it used"

Event = tuple[int, TrafficEvent]


@dataclass
class TrafficSums:
    """The scores of some runs of one tracker in one scene."""

    values: list[Array] = field(default_factory=list)
    """Of each run ``(2, paths)`` total and count of each of ``PATHS``."""
    gospa: Array = field(default_factory=lambda: np.zeros((3, 0)))
    """``(3, T)`` sums over runs of the parts of GOSPA at each instant, m^2."""
    existence: ExistenceBins | None = None
    events: list[Event] = field(default_factory=list)
    """With the number of the run: those of the recorded run, and the dearest of the others."""
    recorded: int | None = None
    """The number of the recorded run, if it is one of these."""
    strips: npt.NDArray[np.int8] | None = None
    """``(T, N)`` of the recorded run."""

    def add(self, run: int, scores: RunScores, *, recorded: bool) -> None:
        """One more run, by its number."""
        self.values.append(np.array([scores.values.get(path, (0.0, 0.0)) for path in PATHS]).T)
        parts = np.stack(scores.gospa)
        self.gospa = parts if not self.gospa.size else self.gospa + parts
        self.existence = summed([self.existence, scores.existence])
        self.events += [(run, event) for event in scores.events]
        if recorded:
            self.recorded, self.strips = run, scores.strips
        if len(self.events) > 2 * MOST_EVENTS:
            self.events = dearest(self.events, self.recorded)


def summed(bins: Sequence[ExistenceBins | None]) -> ExistenceBins | None:
    """The sums of several; None where none has any."""
    known = [each for each in bins if each is not None]
    return ExistenceBins(*(sum(column) for column in zip(*known, strict=True))) if known else None


def dearest(events: Sequence[Event], recorded: int | None) -> list[Event]:
    """All events of the recorded run and the dearest of the others, in the order of runs and time."""
    others = [event for event in events if event[0] != recorded]
    if len(others) > MOST_EVENTS:
        others = heapq.nlargest(MOST_EVENTS, others, key=lambda item: (item[1].cost, -item[0], -item[1].instant))
    own = [event for event in events if event[0] == recorded]
    return sorted([*own, *others], key=lambda item: (item[0], item[1].instant))


@dataclass
class TrafficEvaluation:
    """What one tracker reached over all runs."""

    blocks: list[TrafficSums]
    intervals: dict[str, Interval]
    """By metric, clustered by scene."""
    reused_ids: int
    step_time: float
    """Microseconds for a scan of one run."""
    known: bool = True
    """Whether there is a truth."""
    own: dict[str, MetricValue] = field(default_factory=dict)
    """By path, of the metrics that are not built in."""
    own_intervals: dict[str, Interval] = field(default_factory=dict)
    """By path, of those that are means over runs, what each run adds."""
    broken: dict[str, str] = field(default_factory=dict)
    """By name, why a metric raised."""

    @property
    def nothing_due(self) -> bool:
        """Whether there is a truth, and nothing of it had to be tracked."""
        return self.known and not self.sums("matched_share")[1].any()

    def sums(self, path: str) -> Array:
        """``(2, runs)`` totals and counts of a metric; zeros where a run cannot tell it."""
        column = PATHS.index(path)
        return np.array([values[:, column] for block in self.blocks for values in block.values]).T

    @property
    def values(self) -> dict[str, MetricValue]:
        """As they stand in a result."""
        found = {}
        for path, metric in track_metrics(self.known).items():
            if path in self.intervals:
                found[path] = self.intervals[path].as_value(metric.unit)
            else:
                reason = NOTHING_DUE if self.nothing_due else _why_missing(path)
                found[path] = metric.no_value(reason)
        if not self.known:
            found |= {path: metric.no_value(NO_TRUTH) for path, metric in TRACK_METRICS.items()}
        found |= self.own
        found["step_time"] = MetricValue(value=self.step_time, unit="us")
        return found


def track_metrics(known: bool) -> dict[str, RunRatio]:
    """The metrics by name; ``known``: whether there is a truth."""
    return TRACK_METRICS if known else DETECTION_METRICS


def _why_missing(path: str) -> str:
    if "association" in path or path in OF_USE:
        return NOT_SAID
    if path == "confirm_latency":
        return "no object was ever tracked"
    return NOT_ASKED if path in OF_PREDICTIONS else "no run tells it"
