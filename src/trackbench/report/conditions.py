"""A tracker's scores under each condition: manoeuvre, range band or time since it was first seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from trackbench.report.calibration import Quantity
from trackbench.results import ConditionScores, MetricValue, TrackerResult

By = Literal["manoeuvre", "range", "age"]
BY: tuple[By, ...] = ("manoeuvre", "range", "age")
TITLE = {"manoeuvre": "manoeuvre", "range": "range band", "age": "time since first seen"}
UNIT = {"position": "m", "velocity": "m/s"}


def conditions(tracker: TrackerResult, by: By) -> Mapping[str, ConditionScores]:
    """A tracker's scores by one of these."""
    if tracker.breakdown is None:
        return {}
    found: Mapping[str, ConditionScores] = getattr(tracker.breakdown, by)
    return found


def classes(trackers: Sequence[TrackerResult], by: By) -> list[str]:
    """Every condition that any tracker met, in their order."""
    every = [list(conditions(tracker, by)) for tracker in trackers]
    longest = max(every, key=len, default=[])
    return longest + list(dict.fromkeys(name for names in every for name in names if name not in longest))


def rmse(scores: ConditionScores | None, quantity: Quantity) -> MetricValue | None:
    """The RMSE of a quantity under one condition."""
    if scores is None:
        return None
    return scores.position_rmse if quantity == "position" else scores.velocity_rmse
