"""Paired differences between trackers, with p-values corrected over a :class:`Family`, and verdicts."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, compress

import numpy as np

from trackbench.metrics.contrasts import Contrast, all_paired
from trackbench.metrics.intervals import Interval
from trackbench.metrics.protocol import Direction, Metric
from trackbench.results import Difference, MetricValue
from trackbench.results.scenario_summary import MarginSummary

#: Level at which a difference is shown to be more than the margin, after the correction.
LEVEL = 0.05
#: Number of trackers above which each is compared with the best alone: the number of pairs grows with the square.
MOST_PAIRED = 30
#: Share of a squared error charged for missing estimates above which a difference is also taken without the charge.
MOST_CHARGED = 0.1
EQUIVALENT, UNDECIDED = "equivalent", "undecided"
#: Verdicts on the first of two trackers; ``larger`` and ``smaller`` where neither is better.
VERDICTS = ("better", "worse", "larger", "smaller", EQUIVALENT, UNDECIDED)


@dataclass(frozen=True)
class Family:
    """Differences that are corrected together, so that 5 % is the risk of any wrong verdict among them all.

    The family holds the differences by the metric that ranks, and the differences that an expectation names.
    """

    against: str | None = None
    """Name of the tracker that all other trackers are compared with; None where every pair is compared."""
    selected: bool = False
    """Whether the tracker ``against`` was selected by its best value in the same data."""
    expected: Collection[tuple[str, frozenset[str]]] = ()
    """Metric path and the names of the two trackers, for each expectation that compares two trackers."""

    def pairs(self, names: Sequence[str], path: str) -> list[tuple[str, str]]:
        """Return the pairs of trackers that are compared by the metric with this dotted path."""
        if self.against is None:
            return [*combinations(names, 2)]
        to_one = [(self.against, name) for name in names if self.against in names and name != self.against]
        expected = {pair for metric, pair in self.expected if metric == path and self.against not in pair}
        return [*to_one, *((a, b) for a, b in map(sorted, expected) if a in names and b in names)]


def corrected_p_values(p_values: Sequence[float], choices: Sequence[float]) -> list[float]:
    """Correct p-values for the number of tests, and for the choice of the best tracker in the same data.

    A tracker is called worse than the best only where the verdict holds whichever other tracker is the best. Chance may
    have made any of the other trackers the best, so the one-sided p-value is multiplied by their number. Holm's
    correction over all trackers follows. In 95 % of the cases no tracker that is as good as the best is called worse.
    Source: Hsu (1984), "Constrained simultaneous confidence intervals for multiple comparisons with the best", Annals
    of Statistics 12, with Bonferroni's bound in place of equal variances.

    Args:
        p_values: two-sided p-values.
        choices: factor of each p-value for the choice of the best tracker; 0 leaves the p-value unchanged. The factor
            is the number of other trackers if another metric chose the best tracker, and half of that number if the
            tested metric did.
    """
    selected = [min(1.0, number * p) if number else p for p, number in zip(p_values, choices, strict=True)]
    # The hypothesis that the best is as good as the best counts too.
    return holm([*selected, *([1.0] if any(choices) else [])])[: len(p_values)]


def holm(p_values: Sequence[float]) -> list[float]:
    """Correct p-values for the number of tests. Source: Holm (1979), "A simple sequentially rejective procedure"."""
    values = np.asarray(p_values, dtype=float)
    order, remaining = np.argsort(values, kind="stable"), np.arange(len(values), 0, -1)
    corrected = np.empty(len(values))
    corrected[order] = np.maximum.accumulate(np.minimum(1.0, remaining * values[order]))
    return corrected.tolist()


EVERY_PAIR = Family()
#: Path, metric, the two trackers, and their difference.
_Compared = tuple[str, Metric, str, str, Contrast]


def tracker_differences(
    trackers: Mapping[str, Mapping[str, Interval]],
    metrics: Sequence[Metric],
    margin: MarginSummary,
    values: Mapping[str, Mapping[str, MetricValue]],
    family: Family = EVERY_PAIR,
) -> list[Difference]:
    """Return the differences of tracker pairs by every compared metric; differences in the family have a verdict.

    Args:
        trackers: by tracker name, the intervals of the metrics that are means over runs, by path.
        metrics: all metrics of the scenario.
        margin: largest differences that do not matter.
        values: by tracker name, all metric values by path.
        family: rule for the pairs to compare, and for the differences that get a verdict.
    """
    paths = list(dict.fromkeys(path for intervals in trackers.values() for path in intervals))
    compared = [
        item
        for metric in metrics
        if metric.compared and metric.better is not None
        # The metric itself, or its value for each sensor.
        for path in paths
        if path == metric.name or path.startswith(f"{metric.name}.")
        for item in _compared_by(path, metric, trackers, margin, family)
    ]
    judged = [metric.ranks or (path, frozenset((a, b))) in family.expected for path, metric, a, b, _ in compared]
    tested = list(compress(compared, judged))
    to_best = [family.selected and metric.ranks and a == family.against for _, metric, a, _, _ in tested]
    choices = [is_to_best * sum(to_best) / 2 for is_to_best in to_best]
    p_values = iter(corrected_p_values([contrast.p_value for *_, contrast in tested], choices))
    return [
        _difference(*item, values, next(p_values) if is_judged else None)
        for item, is_judged in zip(compared, judged, strict=True)
    ]


def _compared_by(
    path: str, metric: Metric, trackers: Mapping[str, Mapping[str, Interval]], margin: MarginSummary, family: Family
) -> Iterator[_Compared]:
    names = [name for name, intervals in trackers.items() if path in intervals]
    pairs, place = family.pairs(names, path), {name: number for number, name in enumerate(names)}
    contrasts = all_paired(
        [trackers[name][path] for name in names],
        [(place[a], place[b]) for a, b in pairs],
        lambda a, b: margin_between(a, b, metric.unit, metric.better, margin),
    )
    for (a, b), contrast in zip(pairs, contrasts, strict=True):
        yield path, metric, a, b, contrast


def _difference(
    path: str,
    metric: Metric,
    a: str,
    b: str,
    contrast: Contrast,
    values: Mapping[str, Mapping[str, MetricValue]],
    p_value: float | None,
) -> Difference:
    without_charged = difference_without_charged(values[a].get(path), values[b].get(path))
    verdict = None if p_value is None else verdict_on_first(contrast, p_value, metric.better, without_charged)
    better = {"better": a, "worse": b}.get(verdict or "")
    return Difference(
        a=a,
        b=b,
        metric=path,
        unit=metric.unit,
        value=contrast.value,
        ci95=contrast.ci95,
        margin=contrast.margin,
        p_value=p_value,
        better=better,
        verdict=verdict if better is None else f"{better} better",
        without_charged=without_charged,
    )


def difference_without_charged(a: MetricValue | None, b: MetricValue | None) -> float | None:
    """Return ``a - b`` over given estimates alone; None unless over a tenth of an error is charged for missing ones."""
    values = [item for item in (a, b) if item is not None and item.value is not None]
    if len(values) < 2 or max(item.charged_share or 0.0 for item in values) <= MOST_CHARGED:
        return None
    first, second = (item.value if item.without_charged is None else item.without_charged for item in values)
    return float(first or 0.0) - float(second or 0.0)


def verdict_on_first(
    difference: Contrast, p_value: float, better: Direction | None, without_charged: float | None
) -> str:
    """Return the verdict on the first of two trackers; neither is better if missing estimates decide the sign.

    Args:
        difference: value of the first tracker minus value of the second.
        p_value: corrected p-value of the difference.
        better: whether smaller or larger values of the metric are better; None where neither is.
        without_charged: difference over the estimates that were given; None where little is charged.
    """
    verdict = contrast_verdict(difference, p_value, better)
    turns = verdict in ("better", "worse") and without_charged is not None and without_charged * difference.value < 0
    return size(difference.value) if turns else verdict


def margin_between(a: Interval, b: Interval, unit: str, better: Direction | None, margin: MarginSummary) -> float:
    """Return the largest difference of two values that does not matter, from ``margin`` and the better value."""
    best = max if better == "larger" else min
    return margin.at(best(a.value, b.value, key=abs), unit)


def contrast_verdict(difference: Contrast, p_value: float, better: Direction | None) -> str:
    """Return the verdict on the first of two trackers: better, worse, larger, smaller, equivalent or undecided.

    More runs turn ``undecided`` into another verdict, once the interval lies outside the margin, or inside.

    Args:
        difference: ``first - second``.
        p_value: corrected p-value of the difference.
        better: whether smaller or larger values of the metric are better; None where neither is.
    """
    if p_value >= LEVEL:
        return EQUIVALENT if difference.equivalent else UNDECIDED
    if better is None:
        return size(difference.value)
    return "better" if (difference.value > 0) == (better == "larger") else "worse"


def size(difference: float) -> str:
    """Return the sign of a difference as ``larger`` or ``smaller``: the verdict where neither direction is better."""
    return "larger" if difference > 0 else "smaller"
