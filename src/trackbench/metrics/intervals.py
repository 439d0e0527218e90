"""Confidence intervals from what is independent: the scenes, or the runs of one scene; steps within a run are not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackbench.base.distributions import t_probability, t_quantile
from trackbench.base.types import Array, Mask
from trackbench.results import MetricValue

#: Relative difference of two values below which it is one of arithmetic, not of what was measured.
ROUNDING = 1e-9
TOO_SHORT = "too short for an interval"
ALL_THE_SAME = "the same in every run, which says nothing of others: no interval"


class Interval(NamedTuple):
    """A value with what each independent run, or scene, adds to it."""

    value: float
    influence: Array
    """``(runs,)`` what each run adds to the value, to first order; its mean is zero. ``(scenes,)`` once clustered."""
    at_least: float = -np.inf
    """What it cannot be below, such as zero for squared errors."""
    at_most: float = np.inf
    """What it cannot be above, such as one for a share."""
    weight: Array | None = None
    """``(runs,)`` how much the value leans to each, to scale; alike unless given."""

    @property
    def corrected(self) -> Array:
        """The influence as if the value did not lean to the runs or scenes that weigh more: the jackknife's correction.

        Source: Bell and McCaffrey (2002), "Bias reduction in standard errors for linear regression with multi-stage
        samples".
        """
        parts = len(self.influence)
        if self.weight is None or parts < 2:
            return self.influence
        rest = np.maximum(1.0 - self.weight / self.weight.sum(), 1.0 / parts**2)
        return np.asarray(self.influence * (1.0 - 1.0 / parts) / rest)

    @property
    def constant(self) -> bool:
        """Whether every run, or scene, adds the same: nothing is known of how they differ."""
        return bool(np.abs(self.influence).max(initial=0.0) <= ROUNDING * abs(self.value))

    @property
    def ci95(self) -> tuple[float, float] | None:
        """The 95 % interval, by Student's t; None with fewer than two runs, or where all are the same.

        Of what has a limit it is that of a function without one, by the delta method: the logarithm of the distance
        from a single limit, the log-odds between two. Such values are skewed away from the limit, and Student's
        interval of the value itself lies too near to it. The interval of a root mean square is so the root of that of
        the mean square, whatever unit it is in.

        Source: Meeker, Hahn and Escobar (2017), "Statistical Intervals", section 7.2.3 and appendix D.5.
        """
        error = _standard_error(self.corrected)
        if error is None or self.constant:
            return None
        reach = t_quantile(0.975, len(self.influence) - 1) * error
        below, above = self.value - self.at_least, self.at_most - self.value
        limited = 0 < below < np.inf, 0 < above < np.inf
        if all(limited):
            factors = np.exp(np.array([-1.0, 1.0]) * reach * (1 / below + 1 / above))
            low, high = (self.at_least + (below + above) * below * factors / (below * factors + above)).tolist()
            return low, high
        if limited[0]:
            low, high = positive_ends(below, reach)
            return self.at_least + low, self.at_least + high
        if limited[1]:
            low, high = positive_ends(above, reach)
            return self.at_most - high, self.at_most - low
        return self.value - reach, self.value + reach

    def as_value(self, unit: str) -> MetricValue:
        """As it stands in a result."""
        ci95 = self.ci95
        reason = TOO_SHORT if len(self.influence) < 2 else ALL_THE_SAME
        return MetricValue(value=self.value, unit=unit, ci95=ci95, reason=reason if ci95 is None else None)


def ratio(total: Array, count: Array, *, at_least: float = -np.inf, at_most: float = np.inf) -> Interval:
    """Mean of a quantity summed within each run: ``sum(total) / sum(count)``, by the delta method.

    Args:
        total: ``(runs,)`` sums.
        count: ``(runs,)`` number of terms in each.
        at_least: what no ratio can be below: zero where no term can be negative.
        at_most: what none can be above: one for a share.
    """
    mean = float(total.sum() / count.sum())
    return Interval(mean, (total - mean * count) / count.mean(), at_least, at_most, count)


def root(mean_square: Interval) -> Interval:
    """The root of a mean square, by the delta method."""
    value = float(np.sqrt(mean_square.value))
    slope = 0.5 / value if value > 0 else 0.0
    return Interval(value, mean_square.influence * slope, 0.0, float(np.sqrt(mean_square.at_most)), mean_square.weight)


def scaled(interval: Interval, factor: float) -> Interval:
    """A positive ``factor`` times the value."""
    value, influence, at_least, at_most, weight = interval
    return Interval(value * factor, influence * factor, at_least * factor, at_most * factor, weight)


def positive_ends(value: float, reach: float) -> tuple[float, float]:
    """The interval of what cannot be negative, symmetric in the logarithm, from half of the symmetric one."""
    factor = float(np.exp(reach / value)) if value > 0 else 1.0
    return value / factor, value * factor


def reach_of_ratio(total: float, count: float, square: float, product: float, count_square: float, runs: int) -> float:
    """Half of the symmetric 95 % interval of :func:`ratio` from sums over runs: of the totals, of the numbers of terms,
    and of their squares and product. For many ratios of which the runs are not kept; NaN with fewer than two runs.
    """
    if runs < 2:
        return float("nan")
    mean = total / count
    squares = max(square - 2 * mean * product + mean**2 * count_square, 0.0)
    return float(t_quantile(0.975, runs - 1) * np.sqrt(squares * runs / (runs - 1)) / count)


def clustered(interval: Interval, scene: NDArray[np.integer[Any]]) -> Interval:
    """The interval from what each scene adds: runs of one scene share its traffic, and are not independent.

    The standard error is the cluster-robust one (Liang and Zeger 1986, "Longitudinal data analysis using generalized
    linear models"). Nothing changes where all runs are of one scene, which can then be spoken of alone.

    Args:
        interval: from runs.
        scene: ``(runs,)`` the number of the scene of each.
    """
    scenes, index = np.unique(scene, return_inverse=True)
    if len(scenes) == 1:
        return interval
    weight = np.ones(len(index)) if interval.weight is None else interval.weight
    influence = np.bincount(index, interval.influence) * len(scenes) / len(index)
    return interval._replace(influence=influence, weight=np.bincount(index, weight).astype(float))


class VarianceShares(NamedTuple):
    """Where the variance of one run's value comes from; the two sum to one."""

    scene: float
    """Between scenes: the traffic."""
    noise: float
    """Between runs of one scene: the measurement noise."""


def variance_shares(interval: Interval, scene: NDArray[np.integer[Any]]) -> VarianceShares | None:
    """The variance components of a one-way random-effects model, by the ANOVA estimator, negative ones set to zero.

    Source: Searle, Casella and McCulloch (1992), "Variance components", section 3.6 (unequal numbers of runs).

    Args:
        interval: from runs, not clustered.
        scene: ``(runs,)`` the number of the scene of each.

    Returns:
        None where they cannot be told apart: one scene, one run in each, or the same value in every run.
    """
    scenes, index, counts = np.unique(scene, return_inverse=True, return_counts=True)
    runs = len(index)
    if not 1 < len(scenes) < runs:
        return None
    means = np.bincount(index, interval.influence) / counts
    within = float(((interval.influence - means[index]) ** 2).sum() / (runs - len(scenes)))
    between = float((counts * (means - interval.influence.mean()) ** 2).sum() / (len(scenes) - 1))
    size = (runs - (counts**2).sum() / runs) / (len(scenes) - 1)
    of_scene = max(0.0, (between - within) / size)
    total = of_scene + within
    return VarianceShares(of_scene / total, within / total) if total > 0 else None


class Contrast(NamedTuple):
    """A difference of two values."""

    value: float
    ci95: tuple[float, float] | None
    """None with fewer than two runs, and where each of the two values is the same in every run."""
    p_value: float
    """Of the hypothesis that the difference is within the margin: twice that of the nearer end, so it is below 5 %
    exactly where the interval lies outside the margin (Murphy and Myors 1999, "Testing the hypothesis that treatments
    have negligible effects"). Without a margin that of the two-sided t test; where the difference is the same in every
    run that of the sign test; 1 with fewer than two runs."""
    margin: float
    """Up to this a difference does not matter; at least what rounding makes."""

    @property
    def equivalent(self) -> bool:
        """Whether the interval lies within the margin.

        So the two one-sided tests show, each at 2.5 % (Schuirmann 1987, "A comparison of the two one-sided tests
        procedure and the power approach").
        """
        return self.ci95 is not None and max(map(abs, self.ci95)) <= self.margin


def paired(a: Interval, b: Interval, margin: float = 0.0) -> Contrast:
    """``a - b`` where both come from the same runs (same truth, same noise), by a paired t test on the influences."""
    (contrast,) = all_pairs([a, b], lambda *_: margin)
    return contrast


def all_pairs(intervals: Sequence[Interval], margin: Callable[[Interval, Interval], float]) -> list[Contrast]:
    """The same of every two of them, in the order of ``itertools.combinations``.

    Args:
        intervals: from the same runs.
        margin: of two of them.
    """
    values = np.array([item.value for item in intervals])
    influences = np.array([item.corrected for item in intervals])
    constant = np.array([item.constant for item in intervals])
    contrasts: list[Contrast] = []
    for first, interval in enumerate(intervals):
        others = slice(first + 1, None)
        margins = np.array([margin(interval, other) for other in intervals[others]])
        freedom, errors = influences.shape[1] - 1, _standard_errors(influences[first] - influences[others])
        varies = ~(constant[first] & constant[others])
        contrasts += _tested(interval.value, values[others], errors, freedom, margins, varies)
    return contrasts


def unpaired(a: Interval, b: Interval, margin: float = 0.0) -> Contrast:
    """``a - b`` where the runs of one have nothing to do with those of the other, by Welch's t test on the influences.

    Source: Welch (1947), "The generalization of Student's problem when several different population variances are
    involved". Where the runs have something in common after all, the interval is too wide rather than too narrow.
    """
    errors = [_standard_error(item.corrected) for item in (a, b)]
    varies = np.array([not (a.constant and b.constant)])
    if errors[0] is None or errors[1] is None:
        return _tested(a.value, np.array([b.value]), None, 0, np.array([margin]), varies)[0]
    squares = [error**2 for error in errors if error is not None]
    total = sum(squares)
    parts = [square**2 / (len(item.influence) - 1) for square, item in zip(squares, (a, b), strict=True)]
    freedom = total**2 / sum(parts) if total > 0 else min(len(a.influence), len(b.influence)) - 1.0
    return _tested(a.value, np.array([b.value]), np.array([np.sqrt(total)]), freedom, np.array([margin]), varies)[0]


def _tested(
    first: float, others: Array, errors: Array | None, freedom: float, margins: Array, varies: Mask
) -> list[Contrast]:
    """``(k,)`` differences of one value and others with their intervals and p-values, from their standard errors;
    ``varies`` is whether the runs tell anything of the errors."""
    values = first - others
    margins = np.maximum(margins, ROUNDING * np.maximum(abs(first), abs(others)))
    if errors is None:
        return [Contrast(value, None, 1.0, own) for value, own in zip(values.tolist(), margins.tolist(), strict=True)]
    reach, excess = t_quantile(0.975, freedom) * errors, abs(values) - margins
    positive = errors > 0
    tails = t_probability(-excess / np.where(positive, errors, 1.0), freedom)
    p_values = np.where(positive, np.minimum(1.0, 2 * tails), np.where(excess > 0, 0.5**freedom, 1.0))
    ends = zip((values - reach).tolist(), (values + reach).tolist(), varies.tolist(), strict=True)
    ci95 = [(low, high) if own else None for low, high, own in ends]
    return list(map(Contrast, values.tolist(), ci95, p_values.tolist(), margins.tolist()))


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values corrected for their number. Source: Holm (1979), "A simple sequentially rejective procedure"."""
    values = np.asarray(p_values, dtype=float)
    order, remaining = np.argsort(values, kind="stable"), np.arange(len(values), 0, -1)
    corrected = np.empty(len(values))
    corrected[order] = np.maximum.accumulate(np.minimum(1.0, remaining * values[order]))
    return corrected.tolist()


def _standard_error(influence: Array) -> float | None:
    errors = _standard_errors(influence[None])
    return None if errors is None else float(errors[0])


def _standard_errors(influences: Array) -> Array | None:
    """``(k,)`` of influences ``(k, runs)``."""
    runs = influences.shape[1]
    return np.asarray(np.std(influences, axis=1, ddof=1) / np.sqrt(runs)) if runs > 1 else None
