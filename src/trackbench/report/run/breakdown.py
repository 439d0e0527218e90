"""Errors and calibration by manoeuvre and by range band."""

from __future__ import annotations

from collections.abc import Sequence

from trackbench.document import Cell, Column, Table, Tone
from trackbench.metrics.conditions import JUMPS
from trackbench.report.calibration import TITLE, UNIT, By, Quantity, calibration, classes, conditions, rmse
from trackbench.report.numbers import NOT_AVAILABLE, decimals, fixed, interval, percent
from trackbench.report.run.cells import INTERVAL, TRACKER, VERDICT
from trackbench.results import ConditionScores, MetricValue, TrackerResult

_NOT_MET = "no estimate of the tracker falls into it"
_TONE: dict[str, Tone] = {"optimistic": "bad", "pessimistic": "warn"}


def errors(trackers: Sequence[TrackerResult], by: By, quantity: Quantity) -> Table:
    """RMSE of each tracker in each class."""
    classed = classes(trackers, by)
    found = [[rmse(conditions(tracker, by).get(name), quantity) for name in classed] for tracker in trackers]
    places = decimals([metric.value for row in found for metric in row if metric])
    rows = [
        (Cell(tracker.name, tracker=tracker.name), *(_error(metric, places) for metric in row))
        for tracker, row in zip(trackers, found, strict=True)
    ]
    columns = [Column(f"{name}, {UNIT[quantity]}", details=INTERVAL) for name in classed]
    caption = f"{quantity.capitalize()} RMSE by {TITLE[by]}"
    return Table(f"{quantity}-rmse-by-{by}", (TRACKER, *columns), tuple(rows), caption)


def calibrations(trackers: Sequence[TrackerResult], by: By, quantity: Quantity) -> Table:
    """Errors over what each tracker states, in each class."""
    classed = classes(trackers, by)
    rows = [
        (
            Cell(tracker.name, tracker=tracker.name),
            *(_calibration(conditions(tracker, by).get(name), quantity) for name in classed),
        )
        for tracker in trackers
    ]
    columns = [Column(name, details=VERDICT) for name in classed]
    caption = f"{quantity.capitalize()} error over its stated standard deviation"
    return Table(f"{quantity}-calibration-by-{by}", (TRACKER, *columns), tuple(rows), caption)


def shares(tracker: TrackerResult, by: By) -> str:
    """How many of a tracker's estimates fall into each class, as a sentence."""
    total = 0 if tracker.breakdown is None else tracker.breakdown.all.count
    said = [f"{name} {_share(scores.count / total)}" for name, scores in conditions(tracker, by).items()]
    return f"Of the estimates of {tracker.name}: {', '.join(said)}."


def after_jumps(trackers: Sequence[TrackerResult]) -> str:
    """How much of the velocity errors belongs to velocity jumps of the truth; nothing where there are none."""
    known = [(tracker, tracker.breakdown) for tracker in trackers if tracker.breakdown]
    found = [(tracker.name, of.jump[JUMPS[1]], of.all) for tracker, of in known if JUMPS[1] in of.jump]
    if not found:
        return ""
    _, near, every = found[0]
    said = [f"{name} {_share(_squares(near) / _squares(every))}" for name, near, every in found]
    begin = f"{_share(near.count / every.count)} of the estimates are within a second after a velocity jump"
    return f"{begin}. Of the squared velocity errors are there: {', '.join(said)}."


def _squares(scores: ConditionScores) -> float:
    """Sum of the squared velocity errors."""
    error = None if scores.velocity_rmse is None else scores.velocity_rmse.value
    return scores.count * (error or 0.0) ** 2


def _share(share: float) -> str:
    return percent(share) if share >= 0.01 else f"less than {percent(0.01)}"


def _error(metric: MetricValue | None, places: int) -> Cell:
    if metric is None or metric.value is None:
        return Cell(NOT_AVAILABLE, reason=_NOT_MET)
    bounds = interval(metric.ci95, places)
    return Cell(fixed(metric.value, places), (bounds,) if bounds else ())


def _calibration(scores: ConditionScores | None, quantity: Quantity) -> Cell:
    found = None if scores is None else calibration(scores, quantity)
    if found is None:
        return Cell(NOT_AVAILABLE, reason=_NOT_MET if scores is None else "the tracker gives no covariance")
    places = decimals([found.ratio], 2)
    details = tuple(text for text in (found.verdict, interval(found.ci95, places)) if text)
    return Cell(fixed(found.ratio, places), details, _TONE.get(found.verdict, ""))
