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
    """Factors on the half widths of Student's 95 % interval, for few scenes or for runs with skewed values."""

    toward: float = 1.0
    """Factor on the half width towards the value's limit: the lower half for an error, whose limit is 0."""
    away: float = 1.0
    """Factor on the side away from the value's limit: above an error."""
    difference: float = 1.0
    """Factor on both sides of the interval of a difference of two values."""


class Parts(NamedTuple):
    """Number and kind of the independent parts that an interval rests on: runs, or scenes."""

    number: int
    scenes: bool
    fewest: float = 2
    """Least number of runs with which the interval of one tracker's value has its stated coverage."""

    @property
    def too_few(self) -> str:
        """Reason why runs or scenes are too few for an interval or a difference; empty where they are enough."""
        if self.scenes and self.number < FEWEST_SCENES:
            return TOO_FEW_SCENES
        return TOO_SHORT if self.number < 2 else ""

    @property
    def uncalibrated(self) -> str:
        """Reason why runs or scenes are too few for the interval of one tracker's value; empty where they are enough.

        The interval of a difference of two trackers needs fewer runs or scenes.
        """
        if self.too_few or self.scenes or self.number >= self.fewest:
            return self.too_few
        if self.fewest == np.inf:
            return f"{UNCALIBRATED} over runs: a few of them decide the value"
        return f"{UNCALIBRATED} with fewer than {self.fewest} runs"

    @property
    def stretch(self) -> Stretch:
        """Factors by which the half widths of Student's interval are stretched for so few runs or scenes.

        A few scenes are much harder than the other scenes. A sample without the hard scenes has too small a mean and
        too small a spread at once, so that nothing in the sample warns. The effect of skewness falls with the root of
        the number of scenes, and with the number itself (Hall 1992, "The Bootstrap and Edgeworth Expansion", section
        2.3). The terms are fitted to scenes of highway, merge and intersection, for six trackers, and measured on other
        scenes: ``benchmarks/calibration/scenes.py``.
        """
        if not self.scenes:
            return Stretch()
        number = self.number
        return Stretch(1.0 - (number + 20) ** -0.5, 1.0 + 3.8 / number**0.6, 1.0 + 1.5 / number**0.5)


class Interval(NamedTuple):
    """Metric value with the influence of each independent run or scene on it, which gives its confidence interval."""

    value: float
    influence: Array
    """``(runs,)`` first-order contribution of each run to the value, with mean zero; ``(scenes,)`` once clustered."""
    at_least: float = -np.inf
    """Smallest possible value, such as zero for squared errors."""
    at_most: float = np.inf
    """Largest possible value, such as one for a share."""
    weight: Array | None = None
    """``(runs,)`` relative weight of each run in the value; None for equal weights."""
    scenes: bool = False
    """Whether ``influence`` has one element for each scene; else one for each run or stretch of time."""
    skewed: bool = False
    """Whether few runs decide the value, so that its interval is stretched by their skewness."""
    fewest: float = 2
    """Least number of runs with which the interval of one tracker's value has its stated coverage."""
    in_time: bool = False
    """Whether ``influence`` has one element for each of successive stretches of time, so that neighbouring elements can
    be correlated."""
    few_decide: bool = False
    """Whether rare scenes, one in a hundred, can decide which of two trackers has the larger value."""
    of_stretches: bool = False
    """Whether ``influence`` has one element for each stretch of a single run; two such values are compared stretch by
    stretch."""
    counted: Counted | None = None
    """``share`` or ``rate`` for a value from counted events, whose interval has the limits of counts; None for other
    values."""
    repeats: float = 1.0
    """Mean number of runs that each influence stands for: above 1 where scenes have several runs."""
    sparse: bool = False
    """Whether runs or scenes of weight 0 tell nothing of the value, so that the interval rests on runs or scenes with a
    weight above 0 alone."""
    details: tuple[tuple[str, float], ...] = ()
    """Further numbers for the metric's fields in a result, as pairs of name and number."""
    power: float = 1.0
    """Exponent that makes the value from a mean: one half for a root mean square."""

    @property
    def corrected(self) -> Array:
        """Influence of each run or scene, enlarged where the run or scene has a large weight, as in the jackknife.

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
        """Whether all runs, or scenes, have the same influence, so that the variation between them is unknown."""
        return bool(np.abs(self.influence).max(initial=0.0) <= ROUNDING * abs(self.value))

    def only(self, there: Mask) -> Interval:
        """Return the interval from the runs or scenes ``there`` ``(parts,)`` alone; all others must have weight 0."""
        weight = None if self.weight is None else self.weight[there]
        return self._replace(influence=self.influence[there] * there.mean(), weight=weight)

    @property
    def telling(self) -> Mask:
        """Mask ``(parts,)`` of the runs or scenes with a weight above 0; a scene without an event has weight 0."""
        return np.ones(len(self.influence), dtype=bool) if self.weight is None else self.weight > 0

    @property
    def is_ratio_of_stretches(self) -> bool:
        """Whether the value is positive and over stretches of a run, so that two trackers are compared by ratio."""
        return self.of_stretches and self.at_least == 0.0 < self.value and self.at_most == np.inf

    @property
    def parts(self) -> Parts:
        """Number and kind of the independent parts of the data: runs, or scenes."""
        return Parts(len(self.influence), self.scenes, self.fewest)

    @property
    def stretch(self) -> Stretch:
        """Factors by which the half widths of Student's interval are stretched, for few scenes or for skewed runs.

        Some values have a limit, such as 0 for an error. Away from the limit, half the skewness of the influence over
        the root of the number of runs is added: Johnson (1978), "Modified t tests and confidence intervals for
        asymmetrical populations". Towards the limit the interval on the logarithmic scale reaches far enough.
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
        """95 % interval by Student's t; None with too few runs or scenes, or where all have the same influence.

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
        """Return the value, its interval and its unit as the ``MetricValue`` that a result holds."""
        if self.sparse:
            return self.only(self.telling)._replace(sparse=False).as_value(unit)
        ci95 = self.ci95
        reason = self.parts.uncalibrated or ALL_THE_SAME
        stated = {"unit": unit, "ci95": ci95, "reason": reason if ci95 is None else None}
        return MetricValue(value=self.value, **stated, **dict(self.details))


def ratio(
    total: Array, count: Array, *, at_least: float = -np.inf, at_most: float = np.inf, scenes: bool = False
) -> Interval:
    """Return ``sum(total) / sum(count)``, the mean of a quantity summed within each run, by the delta method.

    Args:
        total: ``(runs,)`` sum of the quantity in each run.
        count: ``(runs,)`` number of terms in each sum.
        at_least: lower limit of the mean: zero where no term can be negative.
        at_most: upper limit of the mean: one for a share.
        scenes: whether the sums are by scene, not by run.
    """
    mean = float(total.sum() / count.sum())
    return Interval(mean, (total - mean * count) / count.mean(), at_least, at_most, count, scenes)


def root(mean_square: Interval) -> Interval:
    """Return the interval of a root mean square from the interval of the mean square, by the delta method."""
    value = float(np.sqrt(mean_square.value))
    slope, at_most = 0.5 / value if value > 0 else 0.0, float(np.sqrt(mean_square.at_most))
    influence, power = mean_square.influence * slope, 0.5 * mean_square.power
    return mean_square._replace(value=value, influence=influence, at_least=0.0, at_most=at_most, power=power)


def positive_ends(value: float, reach: float, stretch: Stretch) -> tuple[float, float]:
    """Return the ends of a positive value's interval on a logarithmic scale; ``reach``: symmetric half width."""
    reach = reach / value if value > 0 else 0.0
    return value * float(np.exp(-stretch.toward * reach)), value * float(np.exp(stretch.away * reach))


def reach_of_ratio(total: float, count: float, square: float, product: float, count_square: float, runs: int) -> float:
    """Return half of the symmetric 95 % interval of a ratio of sums over runs; NaN below two runs.

    The arguments but ``runs`` are sums over runs: of the totals, of the numbers of terms (``count``), of the squared
    totals (``square``), of the products of total and number (``product``), and of the squared numbers.
    """
    if runs < 2:
        return float("nan")
    mean = total / count
    squares = max(square - 2 * mean * product + mean**2 * count_square, 0.0)
    return float(stdtrit(runs - 1, 0.975) * np.sqrt(squares * runs / (runs - 1)) / count)


def clustered(interval: Interval, scene: NDArray[np.integer[Any]], *, in_time: bool = False) -> Interval:
    """Return the interval over scenes from the interval over runs; runs of one scene share traffic and are dependent.

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
    """Return ``(k,)`` standard errors from influences ``(k, parts)`` of runs, scenes or stretches of time.

    For stretches that follow each other in time, they are those of a first-order autoregressive process: a positive
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
