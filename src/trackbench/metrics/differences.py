"""Differences between trackers on the same noise: tested run by run, corrected for their number, put into words.

The family of the correction is stated by :class:`Family`.
"""

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
#: Of more trackers each is compared with the best alone: the number of pairs grows with the square.
MOST_PAIRED = 30
#: Share of a squared error that is charged for missing estimates above which a difference is looked at without it too.
MOST_CHARGED = 0.1
EQUIVALENT, UNDECIDED = "equivalent", "undecided"
#: Of the first of two; ``larger`` and ``smaller`` where neither is better.
VERDICTS = ("better", "worse", "larger", "smaller", EQUIVALENT, UNDECIDED)


@dataclass(frozen=True)
class Family:
    """Which differences are tested together, so that 5 % is the risk of a single wrong word among all of them.

    They are those of the metric that ranks and those that an expectation names: what the page of a run calls better.
    """

    against: str | None = None
    """The tracker that all others are held against; None: every pair."""
    selected: bool = False
    """Whether it is the one with the best value, and so was found in the same data."""
    expected: Collection[tuple[str, frozenset[str]]] = ()
    """Metric and pair of each expectation that compares two trackers."""

    def pairs(self, names: Sequence[str], path: str) -> list[tuple[str, str]]:
        """Those of some trackers that are compared by a metric."""
        if self.against is None:
            return [*combinations(names, 2)]
        own = [(self.against, name) for name in names if self.against in names and name != self.against]
        stated = {pair for metric, pair in self.expected if metric == path and self.against not in pair}
        others = [(a, b) for a, b in map(sorted, stated) if a in names and b in names]
        return [*own, *others]


def corrected_p_values(p_values: Sequence[float], choices: Sequence[float]) -> list[float]:
    """P-values corrected for their number.

    A tracker is called worse than the best only where it is so whichever of the others is the best: its one-sided
    p-value is multiplied by the number of the others, as any of them may have become the best by chance; then comes
    Holm's correction over all trackers. So in 95 % of the cases no tracker that is as good as the best is called worse.
    Source: Hsu (1984), "Constrained simultaneous confidence intervals for multiple comparisons with the best", Annals
    of Statistics 12, with Bonferroni's bound in place of equal variances.

    Args:
        p_values: two-sided.
        choices: by what each is multiplied before: half the number of the others where one of the two was chosen for
            its value of this metric, the number where for that of another metric, 0 where neither was chosen.
    """
    selected = [min(1.0, number * p) if number else p for p, number in zip(p_values, choices, strict=True)]
    # Of the best too it might have been rejected that it is as good as the best.
    return holm([*selected, *([1.0] if any(choices) else [])])[: len(p_values)]


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values corrected for their number. Source: Holm (1979), "A simple sequentially rejective procedure"."""
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
    """The pairs of the trackers by every metric that is compared; those in the family have a verdict.

    Args:
        trackers: by name, the metrics that are means over runs, by path.
        metrics: all that there are.
        margin: what does not matter.
        values: by name, all metrics by path.
        family: which pairs are compared, and which of them are judged.
    """
    paths = list(dict.fromkeys(path for intervals in trackers.values() for path in intervals))
    compared = [
        item
        for metric in metrics
        if metric.compared and metric.better is not None
        # The metric itself, or that of each sensor.
        for path in paths
        if path == metric.name or path.startswith(f"{metric.name}.")
        for item in _by(path, metric, trackers, margin, family)
    ]
    judged = [metric.ranks or (path, frozenset((a, b))) in family.expected for path, metric, a, b, _ in compared]
    tested = list(compress(compared, judged))
    of_best = [family.selected and metric.ranks and a == family.against for _, metric, a, _, _ in tested]
    choices = [own * sum(of_best) / 2 for own in of_best]
    p_values = iter(corrected_p_values([contrast.p_value for *_, contrast in tested], choices))
    return [
        _difference(*item, values, next(p_values) if own else None) for item, own in zip(compared, judged, strict=True)
    ]


def _by(
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
    alone = difference_without_charged(values[a].get(path), values[b].get(path))
    word = None if p_value is None else verdict_on_first(contrast, p_value, metric.better, alone)
    better = {"better": a, "worse": b}.get(word or "")
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


def verdict_on_first(difference: Contrast, p_value: float, better: Direction | None, alone: float | None) -> str:
    """The verdict on the first of two, where neither is better if the difference turns without what is charged.

    Args:
        difference: the first minus the second.
        p_value: its own, corrected.
        better: which values of the metric are better.
        alone: the same over the estimates that were given; None where little is charged.
    """
    word = contrast_verdict(difference, p_value, better)
    turned = word in ("better", "worse") and alone is not None and alone * difference.value < 0
    return size(difference.value) if turned else word


def margin_between(a: Interval, b: Interval, unit: str, better: Direction | None, margin: MarginSummary) -> float:
    """Up to which difference it does not matter which of two trackers is used."""
    best = max if better == "larger" else min
    return margin.at(best(a.value, b.value, key=abs), unit)


def contrast_verdict(difference: Contrast, p_value: float, better: Direction | None) -> str:
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
