"""Errors, and how large they are beside the standard deviations that a tracker states, by manoeuvre and range band."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from trackbench.document import Cell, Column, Table
from trackbench.metrics.conditions import JUMPS
from trackbench.metrics.consistency import DIRECTIONS
from trackbench.metrics.verdicts import ABOVE, BELOW, SMALLEST_SHARE, condition_verdict, mean_text
from trackbench.report.numbers import NOT_AVAILABLE, decimals, joined_names, percent, rounded
from trackbench.report.tables import INTERVAL, TRACKER, VERDICT, estimate_cell, metric_of, tracker_table
from trackbench.results import Breakdown, ConditionScores, MetricValue, PartVerdict, Result, TrackerResult

#: Beyond these an error is not as large as stated, in standard deviations.
LIMITS = math.sqrt(1 - BELOW), math.sqrt(1 + ABOVE)

Quantity = Literal["position", "velocity"]
QUANTITIES: tuple[Quantity, ...] = ("position", "velocity")
_WHERE = {
    "straight": "on straights",
    "accelerating": "when accelerating",
    "braking": "under braking",
    "turning": "in turns",
    "sensor gap": "in sensor gaps",
}


@dataclass(frozen=True)
class Calibration:
    """RMS error of one quantity over the standard deviation that the tracker states: the root of the mean NEES part
    over its degrees of freedom."""

    quantity: Quantity
    ratio: float
    ci95: tuple[float, float] | None
    verdict: str
    """ "optimistic" or "pessimistic" where the whole interval is beyond ``LIMITS``, else nothing."""


def calibration(scores: ConditionScores, quantity: Quantity) -> Calibration | None:
    """That of the estimates under one condition; None where the tracker states no covariance."""
    nees = scores.nees_position if quantity == "position" else scores.nees_velocity
    if nees is None or nees.value is None:
        return None
    dof = nees.dof
    assert dof is not None
    word = condition_verdict(nees.ci95, dof)
    ci95 = None if nees.ci95 is None else (math.sqrt(nees.ci95[0] / dof), math.sqrt(nees.ci95[1] / dof))
    off = word if word in ("optimistic", "pessimistic") else ""
    return Calibration(quantity, math.sqrt(nees.value / dof), ci95, off)


def calibration_clauses(breakdown: Breakdown) -> list[str]:
    """Where the stated standard deviations are off, such as "optimistic about velocity in turns (errors 1.6 times as
    large as stated)"; none where nothing was shown to be off."""
    entries = breakdown.manoeuvre
    smallest = SMALLEST_SHARE * breakdown.all.count
    by_manoeuvre = {
        name: [item for quantity in QUANTITIES if (item := calibration(scores, quantity))]
        for name, scores in entries.items()
        if scores.count >= smallest
    }
    verdicts = ("optimistic", "pessimistic")
    return [clause for verdict in verdicts for clause in _clauses(verdict, by_manoeuvre, len(entries))]


def _clauses(verdict: str, by_manoeuvre: Mapping[str, Sequence[Calibration]], manoeuvres: int) -> Iterator[str]:
    """One for each set of manoeuvres, of so many that there were, with the quantities that are off in it."""
    by_places: dict[tuple[str, ...], list[Quantity]] = {}
    for quantity in QUANTITIES:
        places = tuple(
            name
            for name, items in by_manoeuvre.items()
            if any(item.quantity == quantity and item.verdict == verdict for item in items)
        )
        if places:
            by_places.setdefault(places, []).append(quantity)
    for places, quantities in by_places.items():
        ratios = [item.ratio for name in places for item in by_manoeuvre[name] if item.quantity in quantities]
        extreme = max(ratios) if verdict == "optimistic" else min(ratios)
        limit = "" if len(ratios) == 1 else "up to " if verdict == "optimistic" else "down to "
        words = joined_names([_WHERE[name] for name in places])
        where = "" if manoeuvres == 1 else " throughout" if len(places) == manoeuvres else f" {words}"
        size = f"errors {limit}{rounded(extreme, 1)} times as large as stated"
        yield f"{verdict} about {joined_names(quantities)}{where} ({size})"


By = Literal["manoeuvre", "range", "age"]
BY: tuple[By, ...] = ("manoeuvre", "range", "age")
TITLE = {"manoeuvre": "manoeuvre", "range": "range band", "age": "time since first seen"}
UNIT = {"position": "m", "velocity": "m/s"}


def scores_by_condition(tracker: TrackerResult, by: By) -> Mapping[str, ConditionScores]:
    """A tracker's scores by one of these."""
    scores: Mapping[str, ConditionScores] = {} if tracker.breakdown is None else getattr(tracker.breakdown, by)
    return scores


def condition_names(trackers: Sequence[TrackerResult], by: By) -> list[str]:
    """Every condition that any tracker met, in their order."""
    every = [list(scores_by_condition(tracker, by)) for tracker in trackers]
    longest = max(every, key=len, default=[])
    return longest + list(dict.fromkeys(name for names in every for name in names if name not in longest))


def _scores(tracker: TrackerResult, by: By, name: str) -> ConditionScores | None:
    """Under one of the conditions, or of all estimates."""
    if name == ALL and tracker.breakdown is not None:
        return tracker.breakdown.all
    return scores_by_condition(tracker, by).get(name)


def rmse(scores: ConditionScores | None, quantity: Quantity) -> MetricValue | None:
    """The RMSE of a quantity under one condition."""
    if scores is None:
        return None
    return scores.position_rmse if quantity == "position" else scores.velocity_rmse


#: What stands beside the conditions.
ALL = "all"
_NOT_MET = "no estimate of the tracker falls into it"


def error_table(trackers: Sequence[TrackerResult], by: By, quantity: Quantity) -> Table:
    """RMSE of each tracker in each class."""
    names = [ALL, *condition_names(trackers, by)]
    metrics = [[rmse(_scores(tracker, by, name), quantity) for tracker in trackers] for name in names]
    places = decimals([metric.value for row in metrics for metric in row if metric])

    def cell(metric: MetricValue | None) -> Cell:
        if metric is None or metric.value is None:
            return Cell(NOT_AVAILABLE, reason=_NOT_MET)
        return estimate_cell(rounded(metric.value, places), metric.ci95, places)

    columns = [Column(f"{name}, {UNIT[quantity]}", details=INTERVAL) for name in names]
    cells = [[cell(metric) for metric in column] for column in metrics]
    caption = f"{quantity.capitalize()} RMSE by {TITLE[by]}"
    return _class_table(f"{quantity}-rmse-by-{by}", trackers, columns, cells, caption)


def calibration_table(trackers: Sequence[TrackerResult], by: By, quantity: Quantity) -> Table:
    """Errors over what each tracker states, in each class."""
    names = [ALL, *condition_names(trackers, by)]

    def cell(scores: ConditionScores | None) -> Cell:
        item = None if scores is None else calibration(scores, quantity)
        if item is None:
            return Cell(NOT_AVAILABLE, reason=_NOT_MET if scores is None else "the tracker gives no covariance")
        places = decimals([item.ratio], 2)
        return estimate_cell(rounded(item.ratio, places), item.ci95, places, item.verdict)

    columns = [Column(name, details=VERDICT) for name in names]
    cells = [[cell(_scores(tracker, by, name)) for tracker in trackers] for name in names]
    caption = f"{quantity.capitalize()} error over its stated standard deviation"
    return _class_table(f"{quantity}-calibration-by-{by}", trackers, columns, cells, caption)


def _class_table(
    name: str, trackers: Sequence[TrackerResult], columns: list[Column], cells: list[list[Cell]], caption: str
) -> Table:
    first = (TRACKER, [Cell(tracker.name, tracker=tracker.name) for tracker in trackers])
    return Table.of_columns(name, [first, *zip(columns, cells, strict=True)], caption)


def condition_shares(tracker: TrackerResult, by: By) -> str:
    """How many of a tracker's estimates fall into each class, as a sentence."""
    total = 0 if tracker.breakdown is None else tracker.breakdown.all.count
    parts = [f"{name} {_share(scores.count / total)}" for name, scores in scores_by_condition(tracker, by).items()]
    return f"Of the estimates of {tracker.name}: {', '.join(parts)}."


def after_jumps(trackers: Sequence[TrackerResult]) -> str:
    """How much of the velocity errors belongs to velocity jumps of the truth; nothing where there are none."""
    jumped = [
        (tracker.name, breakdown.jump[JUMPS[1]], breakdown.all)
        for tracker in trackers
        if (breakdown := tracker.breakdown) and JUMPS[1] in breakdown.jump
    ]
    if not jumped:
        return ""
    _, near, every = jumped[0]
    parts = [f"{name} {_share(_squares(near) / _squares(every))}" for name, near, every in jumped]
    begin = f"{_share(near.count / every.count)} of the estimates are within a second after a velocity jump"
    return f"{begin}. Of the squared velocity errors are there: {', '.join(parts)}."


def _squares(scores: ConditionScores) -> float:
    """Sum of the squared velocity errors."""
    error = None if scores.velocity_rmse is None else scores.velocity_rmse.value
    return scores.count * (error or 0.0) ** 2


def _share(share: float) -> str:
    return percent(share) if share >= 0.01 else f"less than {percent(0.01)}"


_UNJUDGED = Cell(NOT_AVAILABLE, reason="too few estimates of the tracker to judge it")


def condition_nees_table(result: Result) -> Table | None:
    """Mean NEES of each tracker under each condition that any was judged by; None where none was."""
    nees = [metric_of(tracker, "nees") for tracker in result.scored]
    judged = [{item.name: item for item in metric.conditions or ()} for metric in nees]
    every = [_UNJUDGED if m.mean is None else estimate_cell(mean_text(m.mean), m.ci95, 1) for m in nees]
    columns = [(Column(ALL, details=INTERVAL), every)]
    for name in dict.fromkeys(name for items in judged for name in items):
        verdicts = [items.get(name) for items in judged]
        cells = [_UNJUDGED if v is None else estimate_cell(mean_text(v.mean), v.ci95, 1, v.verdict) for v in verdicts]
        columns.append((Column(name, details=VERDICT), cells))
    caption = "Mean NEES under each condition, 4 expected"
    return tracker_table("nees-by-condition", result.scored, columns, caption) if any(judged) else None


def nees_parts_table(result: Result) -> Table | None:
    """Share of the NEES beyond two points of chi-square, and the NEES along and across the motion, of each tracker;
    None where no tracker has enough estimates."""
    judged = [{item.name: item for item in metric_of(tracker, "nees").parts or ()} for tracker in result.scored]
    caption = "Tails of the NEES, and NEES by direction"
    columns = [
        (Column(_heading(part), details=VERDICT), [_part(items.get(name)) for items in judged])
        for name, part in {name: part for items in judged for name, part in items.items()}.items()
    ]
    return tracker_table("nees-parts", result.scored, columns, caption) if columns else None


def _heading(part: PartVerdict) -> str:
    share = part.name not in DIRECTIONS
    return f"{part.name}, {100 * part.expected:g} % expected" if share else f"{part.name}, {part.expected:g} expected"


def _part(part: PartVerdict | None) -> Cell:
    """A mean of about 1, or a share in percent."""
    if part is None:
        return _UNJUDGED
    value, low, high = (each if part.name in DIRECTIONS else 100 * each for each in (part.value, *part.ci95))
    return estimate_cell(rounded(value, 2), (low, high), 2, part.verdict)
