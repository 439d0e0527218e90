"""Differences between trackers on the same noise: tested run by run, corrected for their number, put into words."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import combinations

from trackbench.metrics.intervals import Contrast, Interval, all_pairs, holm
from trackbench.metrics.protocol import Direction, Metric
from trackbench.results import Difference, MetricValue
from trackbench.results.score_summary import MarginSummary

#: Level at which a difference is shown to be more than the margin, after the correction.
LEVEL = 0.05
#: More trackers than this are a sweep: the number of pairs, which grows with the square, is written for the metric that
#: ranks alone.
MOST_WITH_ALL_METRICS = 30
#: Share of a squared error that is charged for missing estimates above which a difference is looked at without it too.
MOST_CHARGED = 0.1
EQUIVALENT, UNDECIDED = "equivalent", "undecided"
#: Of the first of two; ``larger`` and ``smaller`` where neither is better.
VERDICTS = ("better", "worse", "larger", "smaller", EQUIVALENT, UNDECIDED)


def differences(
    trackers: Mapping[str, Mapping[str, Interval]],
    metrics: Sequence[Metric],
    margin: MarginSummary,
    values: Mapping[str, Mapping[str, MetricValue]],
    wanted: Collection[str] = (),
) -> list[Difference]:
    """Every pair of trackers by every metric that is compared, the p-values of each metric corrected for their number.

    With more than ``MOST_WITH_ALL_METRICS`` trackers by the metric that ranks and the metrics ``wanted`` alone.

    Args:
        trackers: by name, the metrics that are means over runs, by path.
        metrics: all that there are.
        margin: what does not matter.
        values: by name, all metrics by path.
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
    return [item for path, metric in by_path for item in _by(path, metric, trackers, margin, values)]


def _by(
    path: str,
    metric: Metric,
    trackers: Mapping[str, Mapping[str, Interval]],
    margin: MarginSummary,
    values: Mapping[str, Mapping[str, MetricValue]],
) -> Iterator[Difference]:
    """Every pair of the trackers that have the metric."""
    names = [name for name, intervals in trackers.items() if path in intervals]
    contrasts = all_pairs(
        [trackers[name][path] for name in names], lambda a, b: margin_between(a, b, metric.unit, metric.better, margin)
    )
    corrected = holm([item.p_value for item in contrasts])
    for (a, b), item, p_value in zip(combinations(names, 2), contrasts, corrected, strict=True):
        alone = difference_without_charged(values[a].get(path), values[b].get(path))
        word = shown(item, p_value, metric.better, alone)
        better = {"better": a, "worse": b}.get(word)
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
            without_charged=alone,
        )


def difference_without_charged(a: MetricValue | None, b: MetricValue | None) -> float | None:
    """``a - b`` over the estimates that were given; None where no more than ``MOST_CHARGED`` of either is charged."""
    values = [item for item in (a, b) if item is not None and item.value is not None]
    if len(values) < 2 or max(item.charged_share or 0.0 for item in values) <= MOST_CHARGED:
        return None
    first, second = (item.value if item.without_charged is None else item.without_charged for item in values)
    return float(first or 0.0) - float(second or 0.0)


def shown(difference: Contrast, p_value: float, better: Direction | None, alone: float | None) -> str:
    """The verdict on the first of two, where neither is better if the difference turns without what is charged.

    Args:
        difference: the first minus the second.
        p_value: its own, corrected.
        better: which values of the metric are better.
        alone: the same over the estimates that were given; None where little is charged.
    """
    word = verdict(difference, p_value, better)
    turned = word in ("better", "worse") and alone is not None and alone * difference.value < 0
    return size(difference.value) if turned else word


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
