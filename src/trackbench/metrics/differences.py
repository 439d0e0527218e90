"""Differences between trackers on the same noise: tested run by run, corrected for their number, put into words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

from trackbench.metrics.intervals import Interval, holm, paired
from trackbench.metrics.protocol import Direction, Metric
from trackbench.results import Difference

#: Level at which a difference is real, after the correction.
LEVEL = 0.05
NO_DIFFERENCE = "no difference shown"


def differences(trackers: Mapping[str, Mapping[str, Interval]], metrics: Sequence[Metric]) -> list[Difference]:
    """Every pair of trackers by every metric that is compared, the p-values of each metric corrected for their number.

    Args:
        trackers: by name, the metrics that are means over runs, by path.
        metrics: all that there are.
    """
    return [
        difference
        for metric in metrics
        if metric.compared and metric.better is not None
        for path in _paths(metric, trackers)
        for difference in _of(path, metric.unit, metric.better, trackers)
    ]


def better_of(value: float, p_value: float, better: Direction) -> int:
    """Which of two trackers is better by a difference ``first - second``: 0 the first, 1 the second, -1 none is shown.

    Args:
        value: the difference.
        p_value: corrected.
        better: which values of the metric are better.
    """
    if p_value >= LEVEL:
        return -1
    return int((value < 0) != (better == "smaller"))


def _paths(metric: Metric, trackers: Mapping[str, Mapping[str, Interval]]) -> list[str]:
    """The metric itself, or that of each sensor."""
    found = (path for intervals in trackers.values() for path in intervals)
    return list(dict.fromkeys(path for path in found if path == metric.name or path.startswith(f"{metric.name}.")))


def _of(
    path: str, unit: str, better: Direction, trackers: Mapping[str, Mapping[str, Interval]]
) -> Sequence[Difference]:
    pairs = [pair for pair in combinations(trackers, 2) if all(path in trackers[name] for name in pair)]
    found = [paired(trackers[a][path], trackers[b][path]) for a, b in pairs]
    corrected = holm([item.p_value for item in found])
    differences = []
    for pair, item, p_value in zip(pairs, found, corrected, strict=True):
        place = better_of(item.value, p_value, better)
        winner = None if place < 0 else pair[place]
        differences.append(
            Difference(
                a=pair[0],
                b=pair[1],
                metric=path,
                unit=unit,
                value=item.value,
                ci95=item.ci95,
                p_value=p_value,
                better=winner,
                verdict=NO_DIFFERENCE if winner is None else f"{winner} better",
            )
        )
    return differences
