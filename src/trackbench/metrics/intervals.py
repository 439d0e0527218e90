"""Confidence intervals from independent parts: scenes, or runs of one scene; steps within a run are dependent."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from trackbench.base.types import Array, Mask
from trackbench.metrics.count_intervals import Counted, count_limits
from trackbench.results import MetricValue

#: Relative difference of two values that is attributed to rounding.
ROUNDING = 1e-9
TOO_SHORT = "too short for an interval"
ALL_THE_SAME = "no interval: the value is the same in every run"
#: Least number of scenes for an interval and a verdict; intervals are calibrated from here on.
FEWEST_SCENES = 5
#: Least number of stretches of a single run for a comparison of two trackers.
FEWEST_STRETCHES = 4
UNCALIBRATED = "no valid interval"
TOO_FEW_SCENES = f"{UNCALIBRATED} with fewer than {FEWEST_SCENES} scenes; the report shows each of them"


class Stretch(NamedTuple):
    """Factors on the reach of Student's interval; a value with one limit has the interval on the logarithmic scale."""

    toward: float = 1.0
    """Factor towards the limit: below an error."""
    away: float = 1.0
    """Factor away from the limit: above an error."""
    difference: float = 1.0
    """Factor for a difference of two values."""


class Parts(NamedTuple):
    """Independent parts that an interval rests on: runs, or scenes."""

    number: int
    scenes: bool
    fewest: float = 2
    """Least number of runs for a calibrated interval of one tracker."""

    @property
    def too_few(self) -> str:
        """Reason why the parts are too few for an interval or a difference; empty where they are enough."""
        if self.scenes and self.number < FEWEST_SCENES:
            return TOO_FEW_SCENES
        return TOO_SHORT if self.number < 2 else ""

    @property
    def uncalibrated(self) -> str:
        """Reason why the parts are too few for the interval of one tracker, if not for a difference; else empty."""
        if self.too_few or self.scenes or self.number >= self.fewest:
            return self.too_few
        if self.fewest == np.inf:
            return f"{UNCALIBRATED} over runs: a few of them decide the value"
        return f"{UNCALIBRATED} with fewer than {self.fewest} runs"

    @property
    def stretch(self) -> Stretch:
        """Factors on the reach of Student's interval over this number of parts.

        A few scenes are much harder than the others. A sample without them has too small a mean and too small a spread
        at once, so that nothing in it warns. The effect of skewness falls with the root of the number of scenes, and
        with the number itself (Hall 1992, "The Bootstrap and Edgeworth Expansion", section 2.3). The terms are fitted
        to scenes of highway, merge and intersection, for six trackers, and measured on other scenes:
        ``benchmarks/calibration/scenes.py``.
        """
        if not self.scenes:
            return Stretch()
        number = self.number
        return Stretch(1.0 - (number + 20) ** -0.5, 1.0 + 3.8 / number**0.6, 1.0 + 1.5 / number**0.5)


class Interval(NamedTuple):
    """Metric value with the influence of each independent run, or scene."""

    value: float
    influence: Array
    """``(runs,)`` first-order contribution of each run to the value, with mean zero; ``(scenes,)`` once clustered."""
    at_least: float = -np.inf
    """Lower limit of the value, such as zero for squared errors."""
    at_most: float = np.inf
    """Upper limit of the value, such as one for a share."""
    weight: Array | None = None
    """``(runs,)`` relative weight of each run in the value; None for equal weights."""
    scenes: bool = False
    """Whether each part is a scene, and not a run."""
    skewed: bool = False
    """Whether few runs decide the value, so that its interval is stretched by their skewness."""
    fewest: float = 2
    """Least number of runs for a calibrated interval."""
    in_time: bool = False
    """Whether the parts are successive stretches of time, so that neighbours may be correlated."""
    few_decide: bool = False
    """Whether one scene of a hundred may decide the value."""
    of_stretches: bool = False
    """Whether the parts are stretches of single runs, over which two values are compared."""
    counted: Counted | None = None
    """Kind of a counted value, whose interval has the limits of counts; None for other values."""
    repeats: float = 1.0
    """Mean number of runs of each part."""
    sparse: bool = False
    """Whether parts of weight 0 tell nothing of the value, so that its interval rests on the others alone."""
    details: tuple[tuple[str, float], ...] = ()
    """Further fields of the value in a result: name and number."""
    power: float = 1.0
    """Exponent that makes the value from a mean: one half for a root mean square."""

    @property
    def corrected(self) -> Array:
        """Influence, corrected as in the jackknife for runs or scenes with large weights.

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
        """Whether every run, or scene, contributes the same, so that nothing is known of their variation."""
        return bool(np.abs(self.influence).max(initial=0.0) <= ROUNDING * abs(self.value))

    def only(self, there: Mask) -> Interval:
        """Return the interval from the parts ``there`` ``(parts,)``, if all others have weight 0."""
        weight = None if self.weight is None else self.weight[there]
        return self._replace(influence=self.influence[there] * there.mean(), weight=weight)

    @property
    def telling(self) -> Mask:
        """Mask ``(parts,)`` of the parts with a weight; others, such as scenes without an event, tell nothing."""
        return np.ones(len(self.influence), dtype=bool) if self.weight is None else self.weight > 0

    @property
    def is_ratio_of_stretches(self) -> bool:
        """Whether the value is positive and over stretches of a run, so that two are compared by their ratio."""
        return self.of_stretches and self.at_least == 0.0 < self.value and self.at_most == np.inf

    @property
    def parts(self) -> Parts:
        """Number and kind of the parts."""
        return Parts(len(self.influence), self.scenes, self.fewest)

    @property
    def stretch(self) -> Stretch:
        """Factors on the reach of Student's interval: for scenes by their number, for skewed runs by their skewness.

        Away from the limit, half the skewness of the influence over the root of the number of runs is added: Johnson
        (1978), "Modified t tests and confidence intervals for asymmetrical populations". Towards the limit the interval
        on the logarithmic scale reaches far enough.
        """
        if self.scenes or not self.skewed or self.parts.too_few or self.constant:
            return self.parts.stretch
        offset = self.corrected - self.corrected.mean()
        skewness = float((offset**3).mean() / (offset**2).mean() ** 1.5)
        away = skewness if self.at_least > -np.inf else -skewness
        return Stretch(away=1.0 + 0.5 * max(away, 0.0) / len(offset) ** 0.5)

    @property
    def error(self) -> float | None:
        """Standard error of the value; None with too few runs or scenes."""
        return None if self.parts.too_few else float(standard_errors(self.corrected[None], self.in_time)[0])

    @property
    def ci95(self) -> tuple[float, float] | None:
        """95 % interval by Student's t; None with too few parts for a calibrated one, or where all runs are the same.

        A value with a limit is transformed by the delta method: to the logarithm of the distance from a single limit,
        to the log-odds between two. Such values are skewed away from the limit, and Student's interval of the value
        itself lies too near to it. So the interval of a root mean square is the root of the interval of the mean
        square, in any unit. An interval with a single limit is stretched, see ``stretch``.

        Source: Meeker, Hahn and Escobar (2017), "Statistical Intervals", section 7.2.3 and appendix D.5.
        """
        error, stretch = self.error, self.stretch
        if self.counted and error is not None and self.weight is not None:
            amount, parts = float(self.weight.sum()) / self.repeats, self.parts
            return count_limits(self.counted, self.value, amount, error, parts.number, parts.stretch.away)
        if error is None or self.parts.uncalibrated or self.constant:
            return None
        reach = stdtrit(len(self.influence) - 1, 0.975) * error
        below, above = self.value - self.at_least, self.at_most - self.value
        limited = 0 < below < np.inf, 0 < above < np.inf
        if all(limited):
            factors = np.exp(np.array([-1.0, 1.0]) * reach * (1 / below + 1 / above))
            low, high = (self.at_least + (below + above) * below * factors / (below * factors + above)).tolist()
            return low, high
        if limited[0]:
            low, high = positive_ends(below, reach, stretch)
            return self.at_least + low, self.at_least + high
        if limited[1]:
            low, high = positive_ends(above, reach, stretch)
            return self.at_most - high, self.at_most - low
        return self.value - reach, self.value + reach

    def as_value(self, unit: str) -> MetricValue:
        """Return the value and its interval as an entry of a result."""
        if self.sparse:
            return self.only(self.telling)._replace(sparse=False).as_value(unit)
        ci95 = self.ci95
        reason = self.parts.uncalibrated or ALL_THE_SAME
        stated = {"unit": unit, "ci95": ci95, "reason": reason if ci95 is None else None}
        return MetricValue(value=self.value, **stated, **dict(self.details))


def ratio(
    total: Array, count: Array, *, at_least: float = -np.inf, at_most: float = np.inf, scenes: bool = False
) -> Interval:
    """Return the mean of a quantity summed within each run, ``sum(total) / sum(count)``, by the delta method.

    Args:
        total: ``(runs,)`` sums.
        count: ``(runs,)`` number of terms in each sum.
        at_least: lower limit of the mean: zero where no term can be negative.
        at_most: upper limit of the mean: one for a share.
        scenes: whether the sums are by scene, not by run.
    """
    mean = float(total.sum() / count.sum())
    return Interval(mean, (total - mean * count) / count.mean(), at_least, at_most, count, scenes)


def root(mean_square: Interval) -> Interval:
    """Return the root of a mean square, by the delta method."""
    value = float(np.sqrt(mean_square.value))
    slope, at_most = 0.5 / value if value > 0 else 0.0, float(np.sqrt(mean_square.at_most))
    influence, power = mean_square.influence * slope, 0.5 * mean_square.power
    return mean_square._replace(value=value, influence=influence, at_least=0.0, at_most=at_most, power=power)


def positive_ends(value: float, reach: float, stretch: Stretch) -> tuple[float, float]:
    """Return the interval of a positive value on the logarithmic scale; ``reach`` is half of the symmetric interval."""
    reach = reach / value if value > 0 else 0.0
    return value * float(np.exp(-stretch.toward * reach)), value * float(np.exp(stretch.away * reach))


def reach_of_ratio(total: float, count: float, square: float, product: float, count_square: float, runs: int) -> float:
    """Return half of the symmetric 95 % interval of a :func:`ratio` whose runs are not kept; NaN below two runs.

    It takes the sums over runs of the totals, of the numbers of terms, and of their squares and product.
    """
    if runs < 2:
        return float("nan")
    mean = total / count
    squares = max(square - 2 * mean * product + mean**2 * count_square, 0.0)
    return float(stdtrit(runs - 1, 0.975) * np.sqrt(squares * runs / (runs - 1)) / count)


def clustered(interval: Interval, scene: NDArray[np.integer[Any]], *, in_time: bool = False) -> Interval:
    """Return the interval over scenes: runs of one scene share its traffic, and are not independent.

    The standard error is cluster-robust (Liang and Zeger 1986, "Longitudinal data analysis using generalized linear
    models"). If all runs are of one scene, the interval over runs is returned, which holds for this scene alone.

    Args:
        interval: interval over runs.
        scene: ``(runs,)`` number of the scene of each run.
        in_time: whether the scenes are successive stretches of time.
    """
    scenes, index = np.unique(scene, return_inverse=True)
    if len(scenes) == 1:
        return interval
    of_runs, repeats = np.ones(len(index)) if interval.weight is None else interval.weight, len(index) / len(scenes)
    influence, weight = np.bincount(index, interval.influence) / repeats, np.bincount(index, of_runs).astype(float)
    return interval._replace(influence=influence, weight=weight, scenes=True, in_time=in_time, repeats=repeats)


def standard_errors(influences: Array, in_time: bool) -> Array:
    """Return ``(k,)`` standard errors from influences ``(k, parts)``.

    For parts that follow each other in time, they are those of a first-order autoregressive process: a positive
    autocorrelation of neighbours counts, up to one half, without its bias of one over the number of parts
    (Marriott and Pope 1954, "Bias in the estimation of autocorrelations").
    """
    parts = influences.shape[1]
    errors = np.std(influences, axis=1, ddof=1) / np.sqrt(parts)
    if in_time:
        offset = influences - influences.mean(axis=1, keepdims=True)
        square = (offset**2).sum(axis=1)
        correlation = (offset[:, 1:] * offset[:, :-1]).sum(axis=1) / np.where(square > 0, square, 1.0) + 1 / parts
        correlation = np.clip(correlation, 0.0, 0.5)
        errors *= np.sqrt((1 + correlation) / (1 - correlation))
    return np.asarray(errors)
