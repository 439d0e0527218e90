"""Tables of a run's report by condition: errors by manoeuvre and range, and verdicts on covariances."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.document import Cell, Column, Table
from trackbench.metrics.verdicts import MEANING, meaning, what_is_off
from trackbench.report.numbers import NOT_AVAILABLE, decimals, rounded
from trackbench.report.tables import innovation_columns, metric_of, tracker_table
from trackbench.results import Result, TrackerResult

_TITLES = {"manoeuvre": "Position RMSE by manoeuvre, m", "range": "Position RMSE by range, m"}


def condition_tables(result: Result) -> Iterator[Table]:
    """Yield a table of each tracker's position RMSE by manoeuvre, and one by range band, where there are values."""
    trackers = [tracker for tracker in result.scored if tracker.conditions]
    for kind, caption in _TITLES.items():
        start = f"{kind}: "
        by_tracker = [
            {name[len(start) :]: part.metrics for name, part in tracker.conditions.items() if name.startswith(start)}
            for tracker in trackers
        ]
        longest_first = sorted(by_tracker, key=lambda metrics: -len(metrics))
        names = dict.fromkeys(name for metrics in longest_first for name in metrics)
        values = {
            name: [metrics[name]["position_rmse"].value if name in metrics else None for metrics in by_tracker]
            for name in names
        }
        places = decimals([value for column in values.values() for value in column])
        missing = Cell(NOT_AVAILABLE, reason="the tracker has no estimate there")
        columns = [
            (Column(name, "position RMSE, m"), [missing if v is None else Cell(rounded(v, places)) for v in column])
            for name, column in values.items()
        ]
        if columns:
            yield tracker_table(f"position-rmse-by-{kind}", trackers, columns, caption)


def consistency_table(result: Result) -> Table:
    """Return a table of each tracker's innovations by sensor, and where its NEES is off."""

    def deviations(tracker: TrackerResult) -> Cell:
        nees = metric_of(tracker, "nees")
        if nees.verdict == "undecided" and (why := meaning(nees, tracker.conditions)) != MEANING["undecided"]:
            return Cell(why)
        texts = [what_is_off(nees, 2, word) for word in (nees.verdict, nees.also) if word]
        return Cell("; ".join(filter(None, texts)))

    columns = [
        *innovation_columns(result),
        (
            Column(
                "what is off: NEES, 4 expected",
                "NEES under a condition (of position or velocity alone twice theirs), or a share of it",
                left=True,
            ),
            list(map(deviations, result.scored)),
        ),
    ]
    caption = "Can each covariance be believed? trackbench explain TERM explains the words"
    return tracker_table("consistency", result.scored, columns, caption)
