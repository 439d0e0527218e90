"""Differences between trackers on the same noise: tested run by run, corrected for their number, put into words."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import combinations

from trackbench.metrics.intervals import Contrast, Interval, all_pairs, holm
from trackbench.metrics.protocol import Direction, Metric
from trackbench.results import Difference, FewerEstimates
from trackbench.results.score_summary import MarginSummary

#: Level at which a difference is shown to be more than the margin, after the correction.
LEVEL = 0.05
#: More trackers than this are a sweep: the number of pairs, which grows with the square, is written for the metric that
#: ranks alone.
MOST_WITH_ALL_METRICS = 30
#: A tracker whose share of estimates is smaller by more than this is not called better.
SILENCE = 0.01
EQUIVALENT, UNDECIDED = "equivalent", "undecided"
#: Of the first of two; ``larger`` and ``smaller`` where neither is better.
VERDICTS = ("better", "worse", "larger", "smaller", EQUIVALENT, UNDECIDED)


def differences(
    trackers: Mapping[str, Mapping[str, Interval]],
    metrics: Sequence[Metric],
    margin: MarginSummary,
    coverage: Mapping[str, float],
    wanted: Collection[str] = (),
    ranks: str = "position_rmse",
) -> list[Difference]:
    """Every pair of trackers by every metric that is compared, the p-values of each metric corrected for their number.

    With more than ``MOST_WITH_ALL_METRICS`` trackers by the metric that ranks and the metrics ``wanted`` alone.

    Args:
        trackers: by name, the metrics that are means over runs, by path.
        metrics: all that there are.
        margin: what does not matter.
        coverage: by name, the share of the estimates that it should give that a tracker gave.
        wanted: paths of metrics that an expectation compares.
        ranks: the metric that trackers are ranked by.
    """
    kept = None if len(trackers) <= MOST_WITH_ALL_METRICS else {ranks, *wanted}
    found = [
        difference
        for metric in metrics
        if metric.compared and metric.better is not None
        for path in _paths(metric, trackers)
        if kept is None or path in kept
        for difference in _of(path, metric.unit, metric.better, trackers, margin)
    ]
    return [_unless_silent(item, coverage) for item in found]


def _unless_silent(item: Difference, coverage: Mapping[str, float]) -> Difference:
    """Nobody is better who leaves out estimates that the other gives: they may be the hard ones."""
    if item.better is None:
        return item
    (other,) = {item.a, item.b} - {item.better}
    if coverage[item.better] >= coverage[other] - SILENCE:
        return item
    fewer = FewerEstimates(tracker=item.better, share=coverage[other] - coverage[item.better])
    return item.model_copy(update={"better": None, "verdict": size(item.value), "fewer_estimates": fewer})


def margin_between(a: Interval, b: Interval, unit: str, better: Direction | None, margin: MarginSummary) -> float:
    """Up to which difference it does not matter which of two trackers is used."""
    best = max if better == "larger" else min
    return margin.at(best(a.value, b.value, key=abs), unit)


def verdict(found: Contrast, p_value: float, better: Direction | None) -> str:
    """What is shown of the first of two, one of ``VERDICTS``.

    More runs lead from ``undecided`` to one of the others: the interval lies outside the margin, or inside.

    Args:
        found: the difference ``first - second``.
        p_value: its own, corrected.
        better: which values of the metric are better.
    """
    if p_value >= LEVEL:
        return EQUIVALENT if found.equivalent else UNDECIDED
    if better is None:
        return size(found.value)
    return "better" if (found.value > 0) == (better == "larger") else "worse"


def size(difference: float) -> str:
    """The word for a difference that is shown where neither of the two is better."""
    return "larger" if difference > 0 else "smaller"


def _paths(metric: Metric, trackers: Mapping[str, Mapping[str, Interval]]) -> list[str]:
    """The metric itself, or that of each sensor."""
    found = (path for intervals in trackers.values() for path in intervals)
    return list(dict.fromkeys(path for path in found if path == metric.name or path.startswith(f"{metric.name}.")))


def _of(
    path: str, unit: str, better: Direction, trackers: Mapping[str, Mapping[str, Interval]], margin: MarginSummary
) -> Sequence[Difference]:
    pairs = combinations((name for name, intervals in trackers.items() if path in intervals), 2)
    found = all_pairs(
        [intervals[path] for intervals in trackers.values() if path in intervals],
        lambda a, b: margin_between(a, b, unit, better, margin),
    )
    corrected = holm([item.p_value for item in found])
    differences = []
    for pair, item, p_value in zip(pairs, found, corrected, strict=True):
        outcome = verdict(item, p_value, better)
        winner = {"better": pair[0], "worse": pair[1]}.get(outcome)
        differences.append(
            Difference(
                a=pair[0],
                b=pair[1],
                metric=path,
                unit=unit,
                value=item.value,
                ci95=item.ci95,
                margin=item.margin,
                p_value=p_value,
                better=winner,
                verdict=outcome if winner is None else f"{winner} better",
            )
        )
    return differences
