"""What association costs: each tracker that knows which detection is whose beside the best of its filter."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.report.numbers import decimals, in_brackets, margin_words, meaningful, rounded
from trackbench.report.pairs import Pair, Pairs
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
