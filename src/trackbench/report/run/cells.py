"""Cells of the values that a result holds."""

from __future__ import annotations

from collections.abc import Sequence

from trackbench.document import Cell, Column, Tone
from trackbench.report.numbers import NOT_AVAILABLE, decimals, fixed, interval
from trackbench.results import MetricValue, TrackerResult

INTERVAL = "95 % interval"
VERDICT = "verdict, 95 % interval"
NO_METRIC = MetricValue(unit="1", reason="the tracker does not give what this needs")

#: A verdict's colour.
TONE: dict[str, Tone] = {
    "consistent": "good",
    "white": "good",
    "optimistic": "bad",
    "pessimistic": "warn",
    "mixed": "warn",
    "coloured": "warn",
    "undecided": "",
    "": "",
}

TRACKER = Column("tracker", left=True)


def names(trackers: Sequence[TrackerResult]) -> list[Cell]:
    """Each tracker's name, and whether it is no competitor."""
    return [Cell(t.name, (t.reference_kind,) if t.reference_kind else (), tracker=t.name) for t in trackers]


def metric_of(tracker: TrackerResult, path: str) -> MetricValue:
    """A metric, which the tracker may lack."""
    return tracker.metrics.get(path, NO_METRIC)


def values(trackers: Sequence[TrackerResult], path: str, significant: int = 3, scale: float = 1.0) -> list[Cell]:
    """One metric down a column, with the same decimals for all; its verdict and interval are the small print."""
    found = [metric_of(tracker, path) for tracker in trackers]
    places = decimals([None if m.value is None else scale * m.value for m in found], significant)
    return [_value(metric, places, scale) for metric in found]


def missing(metric: MetricValue) -> Cell:
    """Without a value, with its reason."""
    return Cell(NOT_AVAILABLE, reason=metric.reason or str(NO_METRIC.reason))


def count(number: int | None) -> Cell:
    """How often something happened that should not."""
    return Cell(str(number or 0), tone="bad" if number else "")


def _value(metric: MetricValue, places: int, scale: float) -> Cell:
    if metric.value is None:
        return missing(metric)
    bounds = None if metric.ci95 is None else [scale * end for end in metric.ci95]
    details = tuple(text for text in (metric.verdict, interval(bounds, places)) if text)
    return Cell(fixed(scale * metric.value, places), details, TONE.get(metric.verdict or "", ""))
