"""Where a tracker errs and where its covariance is off: the tables of a run's report by condition."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from trackbench.document import Cell, Column, Table
from trackbench.metrics.conditions import JUMPS
from trackbench.metrics.verdicts import meaning, what_is_off
from trackbench.report.numbers import NOT_AVAILABLE, decimals, percent, reach_text, rounded
from trackbench.report.tables import TRACKER, metric_of, missing_cell, name_cells, tone_of, tracker_table
from trackbench.results import ConditionScores, Result, TrackerResult

_TITLES = {"manoeuvre": "Position RMSE by manoeuvre, m", "range": "Position RMSE by range, m"}


def condition_tables(result: Result) -> Iterator[Table]:
    """Yield the position RMSE of each tracker by manoeuvre and by range band; nothing where no result has it."""
    trackers = [tracker for tracker in result.scored if tracker.breakdown is not None]
    for way, caption in _TITLES.items():
        by_tracker: list[dict[str, ConditionScores]] = [dict(getattr(tracker.breakdown, way)) for tracker in trackers]
        longest_first = sorted(by_tracker, key=lambda own: -len(own))
        names = dict.fromkeys(name for own in longest_first for name in own)
        metrics = {name: [own[name].position_rmse if name in own else None for own in by_tracker] for name in names}
        places = decimals([metric.value for own in metrics.values() for metric in own if metric])
        columns = [
            (
                Column(name, "position RMSE, m", details="95 % interval"),
                [
                    Cell(rounded(m.value, places), tuple(filter(None, [reach_text(m.value, m.ci95, places)])))
                    if m is not None and m.value is not None
                    else Cell(NOT_AVAILABLE, reason="no estimate of the tracker falls into it")
                    for m in own
                ],
            )
            for name, own in metrics.items()
        ]
        if columns:
            yield tracker_table(f"position-rmse-by-{way}", trackers, columns, caption)


def covariance_verdict_table(result: Result) -> Table:
    """Return what the covariance of each tracker says of its errors, and what is off, farthest first."""

    def verdict(tracker: TrackerResult) -> Cell:
        nees = metric_of(tracker, "nees")
        if nees.verdict is None:
            return missing_cell(nees)
        return Cell(f"{nees.words}: {meaning(nees, tracker.breakdown)}", tone=tone_of(nees))

    def off(tracker: TrackerResult) -> Cell:
        nees = metric_of(tracker, "nees")
        texts = [what_is_off(nees, 2, word) for word in (nees.verdict, nees.also) if word]
        return Cell("; ".join(filter(None, texts)))

    columns = [
        (TRACKER, name_cells(result.scored)),
        (Column("its covariance", left=True), list(map(verdict, result.scored))),
        (Column("what is off", "NEES under a condition, or a share of it", left=True), list(map(off, result.scored))),
    ]
    return Table.of_columns("covariances", columns)


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
