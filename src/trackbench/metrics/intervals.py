"""Confidence intervals from what is independent: the scenes, or the runs of one scene; steps within a run are not."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from trackbench.base.types import Array, Mask
from trackbench.metrics.count_intervals import Counted, count_limits
from trackbench.results import MetricValue

#: Relative difference of two values below which it is one of arithmetic, not of what was measured.
ROUNDING = 1e-9
TOO_SHORT = "too short for an interval"
ALL_THE_SAME = "the same in every run, which says nothing of others: no interval"
#: With fewer scenes there is no interval and no verdict: what holds is calibrated from here on.
FEWEST_SCENES = 5
#: With fewer stretches of a single run no two trackers are compared.
FEWEST_STRETCHES = 4
UNCALIBRATED = "no interval holds"
TOO_FEW_SCENES = f"{UNCALIBRATED} with fewer than {FEWEST_SCENES} scenes; the report shows each of them"


class Stretch(NamedTuple):
    """What the reach of Student's interval is multiplied by."""

    toward: float = 1.0
    """Of what has one limit, on the logarithmic scale, towards the limit: below an error."""
    away: float = 1.0
    """Of what has one limit, away from it: above an error."""
    difference: float = 1.0
    """Of a difference."""


class Parts(NamedTuple):
    """What an interval rests on: independent runs, or scenes."""

    number: int
    scenes: bool
    fewest: float = 2
    """Runs from which on an interval of one tracker is calibrated."""

    @property
    def too_few(self) -> str:
        """Why there are too few for an interval or a difference; empty where there are enough."""
        if self.scenes and self.number < FEWEST_SCENES:
            return TOO_FEW_SCENES
        return TOO_SHORT if self.number < 2 else ""

    @property
    def uncalibrated(self) -> str:
        """Why there are too few for an interval of one tracker, of which differences may tell; empty where enough."""
        if self.too_few or self.scenes or self.number >= self.fewest:
            return self.too_few
        if self.fewest == np.inf:
            return f"{UNCALIBRATED} over runs, of which few decide the value"
        return f"{UNCALIBRATED} with fewer than {self.fewest} runs"

    @property
    def stretch(self) -> Stretch:
        """How much further than Student's an interval over so many reaches.

        Few scenes are much harder than the others. A sample without them has too small a mean and too small a spread
        at once, so that nothing in it warns of the miss. What skewness costs falls with the root of the number of
        scenes, and with the number itself (Hall 1992, "The Bootstrap and Edgeworth Expansion", section 2.3). The terms
        are fitted to scenes of highway, merge and intersection, for six trackers, and measured on other scenes:
        ``benchmarks/calibration/scenes.py``.
        """
        if not self.scenes:
            return Stretch()
        number = self.number
        return Stretch(1.0 - (number + 20) ** -0.5, 1.0 + 3.8 / number**0.6, 1.0 + 1.5 / number**0.5)


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
    scenes: bool = False
    """Whether each part is a scene, and not a run."""
    skewed: bool = False
    """Whether few runs decide the value, so that its interval is stretched by their skewness."""
    fewest: float = 2
    """Runs from which on the interval is calibrated."""
    in_time: bool = False
    """Whether the parts are stretches of time that follow each other, so that neighbours may be alike."""
    few_decide: bool = False
    """Whether one scene of a hundred may decide the value."""
    of_stretches: bool = False
    """Whether the parts are stretches of single runs, as which two values are compared."""
    counted: Counted | None = None
    """What it is, where its limits are those of counts."""
    repeats: float = 1.0
    """Mean number of runs of each part."""
    sparse: bool = False
    """Whether parts of weight 0 tell nothing of the value, so that its interval rests on the others alone."""
    details: tuple[tuple[str, float], ...] = ()
    """Fields of the value in a result, by name."""
    power: float = 1.0
    """What power the value is of a mean: one half for a root mean square."""

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

    def only(self, there: Mask) -> Interval:
        """From some parts ``(parts,)`` alone, where all others have weight 0."""
        weight = None if self.weight is None else self.weight[there]
        return self._replace(influence=self.influence[there] * there.mean(), weight=weight)

    @property
    def telling(self) -> Mask:
        """``(parts,)`` which have a weight; of the others, such as scenes without an event, the value tells nothing."""
        return np.ones(len(self.influence), dtype=bool) if self.weight is None else self.weight > 0

    @property
    def is_ratio_of_stretches(self) -> bool:
        """Whether it is a positive value over stretches of a run, of which the ratio of two is the steadier one."""
        return self.of_stretches and self.at_least == 0.0 < self.value and self.at_most == np.inf

    @property
    def parts(self) -> Parts:
        """The runs or scenes."""
        return Parts(len(self.influence), self.scenes, self.fewest)

    @property
    def stretch(self) -> Stretch:
        """That of the scenes; of runs of which few decide the value, half their skewness over the root of their number,
        away from the limit.

        The skewness is that of the influence, as in the correction of Johnson (1978), "Modified t tests and confidence
        intervals for asymmetrical populations". Towards the limit the interval on the logarithmic scale reaches far
        enough.
        """
        if self.scenes or not self.skewed or self.parts.too_few or self.constant:
            return self.parts.stretch
        offset = self.corrected - self.corrected.mean()
        skewness = float((offset**3).mean() / (offset**2).mean() ** 1.5)
        away = skewness if self.at_least > -np.inf else -skewness
        return Stretch(away=1.0 + 0.5 * max(away, 0.0) / len(offset) ** 0.5)

    @property
    def error(self) -> float | None:
        """The standard error; None with too few runs or scenes."""
        return None if self.parts.too_few else float(standard_errors(self.corrected[None], self.in_time)[0])

    @property
    def ci95(self) -> tuple[float, float] | None:
        """The 95 % interval, by Student's t; None with fewer parts than calibrate it, or where all runs are the same.

        Of what has a limit it is that of a function without one, by the delta method: the logarithm of the distance
        from a single limit, the log-odds between two. Such values are skewed away from the limit, and Student's
        interval of the value itself lies too near to it. The interval of a root mean square is so the root of that of
        the mean square, whatever unit it is in. That with a single limit is stretched, see ``stretch``.

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
        """As it stands in a result."""
        if self.sparse:
            return self.only(self.telling)._replace(sparse=False).as_value(unit)
        ci95 = self.ci95
        reason = self.parts.uncalibrated or ALL_THE_SAME
        stated = {"unit": unit, "ci95": ci95, "reason": reason if ci95 is None else None}
        return MetricValue(value=self.value, **stated, **dict(self.details))


def ratio(
    total: Array, count: Array, *, at_least: float = -np.inf, at_most: float = np.inf, scenes: bool = False
) -> Interval:
    """Mean of a quantity summed within each run: ``sum(total) / sum(count)``, by the delta method.

    Args:
        total: ``(runs,)`` sums.
        count: ``(runs,)`` number of terms in each.
        at_least: what no ratio can be below: zero where no term can be negative.
        at_most: what none can be above: one for a share.
        scenes: whether the sums are those of scenes.
    """
    mean = float(total.sum() / count.sum())
    return Interval(mean, (total - mean * count) / count.mean(), at_least, at_most, count, scenes)


def root(mean_square: Interval) -> Interval:
    """The root of a mean square, by the delta method."""
    value = float(np.sqrt(mean_square.value))
    slope, at_most = 0.5 / value if value > 0 else 0.0, float(np.sqrt(mean_square.at_most))
    influence, power = mean_square.influence * slope, 0.5 * mean_square.power
    return mean_square._replace(value=value, influence=influence, at_least=0.0, at_most=at_most, power=power)


def positive_ends(value: float, reach: float, stretch: Stretch) -> tuple[float, float]:
    """The interval of what cannot be negative, on the scale of the logarithm, from half of the symmetric one."""
    reach = reach / value if value > 0 else 0.0
    return value * float(np.exp(-stretch.toward * reach)), value * float(np.exp(stretch.away * reach))


def reach_of_ratio(total: float, count: float, square: float, product: float, count_square: float, runs: int) -> float:
    """Half of the symmetric 95 % interval of :func:`ratio` from sums over runs: of the totals, of the numbers of terms,
    and of their squares and product. For many ratios of which the runs are not kept; NaN with fewer than two runs.
    """
    if runs < 2:
        return float("nan")
    mean = total / count
    squares = max(square - 2 * mean * product + mean**2 * count_square, 0.0)
    return float(stdtrit(runs - 1, 0.975) * np.sqrt(squares * runs / (runs - 1)) / count)


def clustered(interval: Interval, scene: NDArray[np.integer[Any]], *, in_time: bool = False) -> Interval:
    """The interval from what each scene adds: runs of one scene share its traffic, and are not independent.

    The standard error is the cluster-robust one (Liang and Zeger 1986, "Longitudinal data analysis using generalized
    linear models"). Nothing changes where all runs are of one scene, which can then be spoken of alone.

    Args:
        interval: from runs.
        scene: ``(runs,)`` the number of the scene of each.
        in_time: whether the scenes are stretches of time that follow each other.
    """
    scenes, index = np.unique(scene, return_inverse=True)
    if len(scenes) == 1:
        return interval
    of_runs, repeats = np.ones(len(index)) if interval.weight is None else interval.weight, len(index) / len(scenes)
    influence, weight = np.bincount(index, interval.influence) / repeats, np.bincount(index, of_runs).astype(float)
    return interval._replace(influence=influence, weight=weight, scenes=True, in_time=in_time, repeats=repeats)


def standard_errors(influences: Array, in_time: bool) -> Array:
    """Return ``(k,)`` standard errors from influences ``(k, parts)``.

    Of parts that follow each other in time it is that of a first-order autoregressive process: the autocorrelation of
    neighbours is allowed for where it is positive, up to one half, without its bias of one over the number of parts
    (Marriott and Pope 1954, "Bias in the estimation of autocorrelations").
    """
    parts = influences.shape[1]
    errors = np.std(influences, axis=1, ddof=1) / np.sqrt(parts)
    if in_time:
        offset = influences - influences.mean(axis=1, keepdims=True)
        square = (offset**2).sum(axis=1)
        alike = (offset[:, 1:] * offset[:, :-1]).sum(axis=1) / np.where(square > 0, square, 1.0) + 1 / parts
        alike = np.clip(alike, 0.0, 0.5)
        errors *= np.sqrt((1 + alike) / (1 - alike))
    return np.asarray(errors)
