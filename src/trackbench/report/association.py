"""What association, confirmation and filtering cost: trackers that share all but one of them, side by side."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from trackbench.document import Cell, Column, Paragraph, Section, Table
from trackbench.report.numbers import decimals, in_brackets, margin_words, meaningful, rounded
from trackbench.report.pairs import Pair, Pairs
from trackbench.report.tables import TRACKER, VERDICT, difference_cells, metric_cells
from trackbench.results import Result, TrackerResult
from trackbench.results.summary import Summary
from trackbench.results.tracker_result import ORACLE


def against_oracle(result: Result) -> Iterator[str]:
    """What the oracles say: how much of the error is left when it is known which detection is whose.

    Each is held against the best of the trackers that share its filter.
    """
    pairs, scored = Pairs(result), result.scored
    for oracle in (tracker for tracker in scored if tracker.association == ORACLE):
        others = [
            other.name
            for other in scored
            if other.association not in (None, ORACLE) and other.describe == oracle.describe
        ]
        pair = pairs.get(others[0], oracle.name) if others else None
        if pair is not None:
            yield _sentence(result.summary, oracle, others[0], pair)


def _sentence(summary: Summary, oracle: TrackerResult, best: str, pair: Pair) -> str:
    places, metric = meaningful(pair.value, pair.ci95), oracle.metrics[summary.headline]
    own = rounded(metric.value, max(places, decimals([metric.value])))
    margin = margin_words([pair.margin])
    bounds = in_brackets(pair.ci95, places, " of the difference")
    # Where the interval alone would say that there is a difference.
    least = 0.0 if pair.ci95 is None else max(pair.ci95[0], -pair.ci95[1])
    why = f": it is not shown to be more than {margin}" if least > 0 else ""
    if least > pair.margin:
        why = (
            ": the interval is of this pair alone, and Holm's correction for the number of pairs does not let it count"
        )
    what = {
        "worse": f"Association and confirmation cost {best} {rounded(pair.value, places)} m more{bounds}",
        "better": f"{best} is {rounded(-pair.value, places)} m below it{bounds}: association is not what limits it",
        "equivalent": f"{best} is equivalent to it{bounds}: association is not what limits it",
    }.get(pair.verdict, f"Whether {best} differs from it is undecided{bounds}{why}")
    return (
        f"{oracle.name} knows which detection is whose: its {summary.headline_name} of {own} m is left by filtering "
        f"and by how tracks begin and end. {what}."
    )


Choice = Literal["association", "confirmation"]
#: By what the trackers of a table differ: its title, and what they share.
_TITLES: dict[Choice, tuple[str, str]] = {
    "association": ("Association under one confirmation rule", "confirmation"),
    "confirmation": ("Confirmation under one association", "association"),
}


def comparisons(result: Result) -> Iterator[Section]:
    """The methods of association that confirm tracks alike, and the confirmations of the same method.

    The trackers of a group share their filter; what knows the origins is none of them.
    """
    for part, (title, shared) in _TITLES.items():
        groups: dict[tuple[str, str], list[TrackerResult]] = {}
        for tracker in result.contenders:
            if tracker.association is not None and tracker.confirmation is not None:
                groups.setdefault((getattr(tracker, shared), tracker.describe), []).append(tracker)
        alike = {key: own for key, own in groups.items() if len({getattr(item, part) for item in own}) > 1}
        if alike:
            tables = [_table(result, part, f"{shared} {key[0]}; {key[1]}", own) for key, own in alike.items()]
            yield Section(title, (Paragraph(_TEXT.format(part=part)), *tables))


_TEXT = "Trackers that differ in {part} alone. Differences, and their verdicts, are those of all pairs of the run."


def _table(result: Result, part: Choice, caption: str, trackers: list[TrackerResult]) -> Table:
    best, metric = trackers[0].name, result.summary.headline
    columns = [
        (TRACKER, [Cell(tracker.name, tracker=tracker.name) for tracker in trackers]),
        (Column(part, left=True), [Cell(str(getattr(tracker, part))) for tracker in trackers]),
        (Column(f"{result.summary.headline_name}, m", details="95 % interval"), metric_cells(trackers, metric)),
        (
            Column(f"minus {best}, m", details=VERDICT),
            [Cell(""), *difference_cells(result, [tracker.name for tracker in trackers[1:]], best)],
        ),
    ]
    return Table.of_columns(f"{part}-{best}", columns, caption[0].upper() + caption[1:])
