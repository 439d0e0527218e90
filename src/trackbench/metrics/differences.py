"""Differences between trackers on the same noise: tested run by run, corrected for their number, put into words."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import combinations

from trackbench.metrics.intervals import ROUNDING, Contrast, Interval, all_pairs, holm
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
) -> list[Difference]:
    """Every pair of trackers by every metric that is compared, the p-values of each metric corrected for their number.

    With more than ``MOST_WITH_ALL_METRICS`` trackers by the metric that ranks and the metrics ``wanted`` alone.

    Args:
        trackers: by name, the metrics that are means over runs, by path.
        metrics: all that there are.
        margin: what does not matter.
        coverage: by name, the share of the estimates that it should give that a tracker gave.
        wanted: paths of metrics that an expectation compares.
    """
    paths = list(dict.fromkeys(path for intervals in trackers.values() for path in intervals))
    by_path = [
        (path, metric)
        for metric in metrics
        if metric.compared and metric.better is not None
        # The metric itself, or that of each sensor.
        for path in paths
        if path == metric.name or path.startswith(f"{metric.name}.")
        if len(trackers) <= MOST_WITH_ALL_METRICS or metric.ranks or path in wanted
    ]
    return [item for path, metric in by_path for item in _by(path, metric, trackers, margin, coverage)]


def _by(
    path: str,
    metric: Metric,
    trackers: Mapping[str, Mapping[str, Interval]],
    margin: MarginSummary,
    coverage: Mapping[str, float],
) -> Iterator[Difference]:
    """Every pair of the trackers that have the metric."""
    names = [name for name, intervals in trackers.items() if path in intervals]
    contrasts = all_pairs(
        [trackers[name][path] for name in names], lambda a, b: margin_between(a, b, metric.unit, metric.better, margin)
    )
    corrected = holm([item.p_value for item in contrasts])
    for (a, b), item, p_value in zip(combinations(names, 2), contrasts, corrected, strict=True):
        word, lost = verdict(item, p_value, metric.better), coverage[b] - coverage[a]
        better, fewer = {"better": a, "worse": b}.get(word), None
        if better is not None and withheld(word, lost):
            fewer = FewerEstimates(tracker=better, share=abs(lost))
            better, word = None, size(item.value)
        yield Difference(
            a=a,
            b=b,
            metric=path,
            unit=metric.unit,
            value=item.value,
            ci95=item.ci95,
            margin=item.margin,
            p_value=p_value,
            better=better,
            verdict=word if better is None else f"{better} better",
            fewer_estimates=fewer,
        )


def withheld(word: str, lost: float) -> bool:
    """Whether a verdict on the first of two does not count.

    Nobody is better who leaves out estimates that the other gives: they may be the hard ones.

    Args:
        word: the verdict.
        lost: by how much the first one's share of the estimates that it should give is smaller.
    """
    return (lost if word == "better" else -lost) > SILENCE * (1 + ROUNDING) and word in ("better", "worse")


def margin_between(a: Interval, b: Interval, unit: str, better: Direction | None, margin: MarginSummary) -> float:
    """Up to which difference it does not matter which of two trackers is used."""
    best = max if better == "larger" else min
    return margin.at(best(a.value, b.value, key=abs), unit)


def verdict(difference: Contrast, p_value: float, better: Direction | None) -> str:
    """What is shown of the first of two, one of ``VERDICTS``.

    More runs lead from ``undecided`` to one of the others: the interval lies outside the margin, or inside.

    Args:
        difference: ``first - second``.
        p_value: its own, corrected.
        better: which values of the metric are better.
    """
    if p_value >= LEVEL:
        return EQUIVALENT if difference.equivalent else UNDECIDED
    if better is None:
        return size(difference.value)
    return "better" if (difference.value > 0) == (better == "larger") else "worse"


def size(difference: float) -> str:
    """The word for a difference that is shown where neither of the two is better."""
    return "larger" if difference > 0 else "smaller"
