"""Where a tracker errs and where its covariance is off: the tables of a run's report by condition."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.document import Cell, Column, Table
from trackbench.metrics.covariance_words import verdict_in_words
from trackbench.metrics.verdicts import MEANING, meaning, what_is_off
from trackbench.report.numbers import NOT_AVAILABLE, decimals, rounded
from trackbench.report.tables import innovation_columns, metric_of, missing_cell, tone_of, tracker_table
from trackbench.results import Result, TrackerResult

_TITLES = {"manoeuvre": "Position RMSE by manoeuvre, m", "range": "Position RMSE by range, m"}


def condition_tables(result: Result) -> Iterator[Table]:
    """Yield the position RMSE of each tracker by manoeuvre and by range band; nothing where no result has it."""
    trackers = [tracker for tracker in result.scored if tracker.conditions]
    for way, caption in _TITLES.items():
        start = f"{way}: "
        by_tracker = [
            {name[len(start) :]: own.metrics for name, own in tracker.conditions.items() if name.startswith(start)}
            for tracker in trackers
        ]
        longest_first = sorted(by_tracker, key=lambda own: -len(own))
        names = dict.fromkeys(name for own in longest_first for name in own)
        values = {
            name: [own[name]["position_rmse"].value if name in own else None for own in by_tracker] for name in names
        }
        places = decimals([value for own in values.values() for value in own])
        missing = Cell(NOT_AVAILABLE, reason="the tracker has no estimate there")
        columns = [
            (Column(name, "position RMSE, m"), [missing if v is None else Cell(rounded(v, places)) for v in own])
            for name, own in values.items()
        ]
        if columns:
            yield tracker_table(f"position-rmse-by-{way}", trackers, columns, caption)


def consistency_table(result: Result) -> Table:
    """Return the words on each covariance, the innovations of each sensor, and what is off, farthest first."""

    def verdict(tracker: TrackerResult) -> Cell:
        nees = metric_of(tracker, "nees")
        if nees.verdict is None:
            return missing_cell(nees)
        return Cell(verdict_in_words(nees, tracker.conditions, whole=False), tone=tone_of(nees), chip=True)

    def off(tracker: TrackerResult) -> Cell:
        nees = metric_of(tracker, "nees")
        if nees.verdict == "undecided" and (why := meaning(nees, tracker.conditions)) != MEANING["undecided"]:
            return Cell(why)
        texts = [what_is_off(nees, 2, word) for word in (nees.verdict, nees.also) if word]
        return Cell("; ".join(filter(None, texts)))

    meanings = "; ".join(f"{word}: {text}" for word, text in MEANING.items())
    columns = [
        (Column("its covariance", meanings, left=True), list(map(verdict, result.scored))),
        *innovation_columns(result),
        (
            Column(
                "what is off: NEES, 4 expected",
                "NEES under a condition (of position or velocity alone twice theirs), or a share of it",
                left=True,
            ),
            list(map(off, result.scored)),
        ),
    ]
    caption = "Can each covariance be believed? trackbench explain TERM explains the words"
    return tracker_table("consistency", result.scored, columns, caption)
