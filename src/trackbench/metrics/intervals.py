"""Confidence intervals from the runs, which are independent; steps within a run are not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.results import MetricValue
from trackbench.types import Array

#: Relative difference of two values below which it is one of arithmetic, not of what was measured.
ROUNDING = 1e-9
ONE_RUN = "one run gives no interval"


class Interval(NamedTuple):
    """A value and its 95 % interval (None with fewer than two runs)."""

    value: float
    influence: Array
    """``(runs,)`` what each run adds to the value, to first order; its mean is zero."""
    ci95: tuple[float, float] | None

    def as_value(self, unit: str) -> MetricValue:
        """As it stands in a result."""
        if self.ci95 is None:
            return MetricValue(value=self.value, unit=unit, reason=ONE_RUN)
        return MetricValue(value=self.value, unit=unit, ci95=self.ci95)


def ratio(total: Array, count: Array) -> Interval:
    """Mean of a quantity summed within each run: ``sum(total) / sum(count)``, by the delta method.

    Args:
        total: ``(runs,)`` sums.
        count: ``(runs,)`` number of terms in each.
    """
    mean = float(total.sum() / count.sum())
    return _interval(mean, (total - mean * count) / count.mean())


def root(mean_square: Interval) -> Interval:
    """The root of a mean square, with the interval carried through by the delta method."""
    value = float(np.sqrt(mean_square.value))
    slope = 0.5 / value if value > 0 else 0.0
    interval = _interval(value, mean_square.influence * slope)
    if interval.ci95 is None:
        return interval
    return interval._replace(ci95=(max(interval.ci95[0], 0.0), interval.ci95[1]))


def reach_of_ratio(total: float, count: float, square: float, product: float, count_square: float, runs: int) -> float:
    """Half of the 95 % interval of :func:`ratio` from sums over runs: of the totals, of the numbers of terms, and of
    their squares and product. For many ratios of which the runs are not kept; NaN with fewer than two runs.
    """
    if runs < 2:
        return float("nan")
    mean = total / count
    squares = max(square - 2 * mean * product + mean**2 * count_square, 0.0)
    return float(_t95(runs - 1) * np.sqrt(squares * runs / (runs - 1)) / count)


def scaled(interval: Interval, factor: float) -> Interval:
    """The interval of ``factor`` times the value."""
    ci = None if interval.ci95 is None else (interval.ci95[0] * factor, interval.ci95[1] * factor)
    return Interval(interval.value * factor, interval.influence * factor, ci)


class Contrast(NamedTuple):
    """A difference of two values."""

    value: float
    ci95: tuple[float, float] | None
    p_value: float
    """Two-sided, of the hypothesis that there is no difference; 1 with fewer than two runs."""


def paired(a: Interval, b: Interval) -> Contrast:
    """``a - b`` where both come from the same runs (same truth, same noise), by a paired t test on the influences."""
    influence = a.influence - b.influence
    return _tested(a, b, _standard_error(influence), len(influence) - 1)


def unpaired(a: Interval, b: Interval) -> Contrast:
    """``a - b`` where the runs of one have nothing to do with those of the other, by Welch's t test on the influences.

    Source: Welch (1947), "The generalization of Student's problem when several different population variances are
    involved". Where the runs have something in common after all, the interval is too wide rather than too narrow.
    """
    errors = [_standard_error(item.influence) for item in (a, b)]
    if errors[0] is None or errors[1] is None:
        return _tested(a, b, None, 0)
    squares = [error**2 for error in errors if error is not None]
    total = sum(squares)
    parts = [square**2 / (len(item.influence) - 1) for square, item in zip(squares, (a, b), strict=True)]
    freedom = total**2 / sum(parts) if total > 0 else 1.0
    return _tested(a, b, float(np.sqrt(total)), freedom)


def _tested(a: Interval, b: Interval, error: float | None, freedom: float) -> Contrast:
    """The difference with its interval and p-value, from its standard error."""
    from scipy import stats

    value = a.value - b.value
    if error is None:
        return Contrast(value, None, 1.0)
    reach = _t95(freedom) * error
    ci95 = (value - reach, value + reach)
    if abs(value) <= ROUNDING * max(abs(a.value), abs(b.value)):
        return Contrast(value, ci95, 1.0)
    return Contrast(value, ci95, float(2 * stats.t.sf(abs(value) / error, freedom)) if error > 0 else 0.0)


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values corrected for their number. Source: Holm (1979), "A simple sequentially rejective procedure"."""
    order = np.argsort(p_values, kind="stable")
    corrected = [1.0] * len(p_values)
    largest = 0.0
    for rank, index in enumerate(order):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[index]))
        corrected[index] = largest
    return corrected


def _standard_error(influence: Array) -> float | None:
    runs = len(influence)
    return float(np.std(influence, ddof=1) / np.sqrt(runs)) if runs > 1 else None


def _interval(value: float, influence: Array) -> Interval:
    error = _standard_error(influence)
    if error is None:
        return Interval(value, influence, None)
    reach = _t95(len(influence) - 1) * error
    return Interval(value, influence, (value - reach, value + reach))


def _t95(freedom: float) -> float:
    """The 97.5 % point of Student's t."""
    # Takes half a second to import, which a scenario that is only checked need not wait for.
    from scipy import stats

    return float(stats.t.ppf(0.975, freedom))
