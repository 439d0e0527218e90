"""Where a tracker errs and where its covariance is off: the tables of a run's report by condition."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.document import Cell, Column, Table
from trackbench.metrics.verdicts import MEANING, what_is_off
from trackbench.report.numbers import NOT_AVAILABLE, decimals, reach_text, rounded
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
    """Return the words on each covariance, and what is off, farthest first."""

    def verdict(tracker: TrackerResult) -> Cell:
        nees = metric_of(tracker, "nees")
        return missing_cell(nees) if nees.verdict is None else Cell(nees.words, tone=tone_of(nees), chip=True)

    def off(tracker: TrackerResult) -> Cell:
        nees = metric_of(tracker, "nees")
        texts = [what_is_off(nees, 2, word) for word in (nees.verdict, nees.also) if word]
        return Cell("; ".join(filter(None, texts)))

    meanings = "; ".join(f"{word}: {text}" for word, text in MEANING.items())
    columns = [
        (TRACKER, name_cells(result.scored)),
        (Column("its covariance", meanings, left=True), list(map(verdict, result.scored))),
        (Column("what is off", "NEES under a condition, or a share of it", left=True), list(map(off, result.scored))),
    ]
    return Table.of_columns("covariances", columns, "Can each covariance be believed? trackbench explain has the words")
