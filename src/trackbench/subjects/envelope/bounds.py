"""One-sided confidence bounds of an :class:`~trackbench.metrics.intervals.Interval`, at levels down to 1e-5.

A map of many cells, each decided at several looks, leaves each look a level such as .00005. Student's t is not
calibrated there: with 25 exponentially distributed runs, its error at level 1e-4 is fifty times too frequent.
``benchmarks/calibration/bounds.py`` measures the error rates of the bounds in this file.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from scipy.special import betaincinv, gammaincinv, ndtri, stdtrit

from trackbench.base.types import Array
from trackbench.metrics.intervals import ALL_THE_SAME, Interval

Side = Literal["lower", "upper"]

#: Fewest runs, and scenes, for a bound; a rate needs twice as many, since few do not show how events cluster.
FEWEST_RUNS, FEWEST_SCENES = 25, 30
#: Factor on the skewness of a sample, which is biased low in small samples.
SKEWNESS = 1.3
#: Coefficient of variation up to which positive values are assumed to be as skewed as lognormal ones.
LOGNORMAL = 1.3
#: Assumed distance of unseen runs, and unseen scenes, from the mean, in standard deviations.
UNSEEN, UNSEEN_SCENES = 2.0, 3.0
#: With fewer than ``-SEEN * log(level)`` scenes, the upper bound assumes an unseen kind of scene: it makes up the
#: share ``RARE`` of all scenes and has ``HARDER`` times the mean.
RARE, HARDER, SEEN = 0.05, 10.0, 30.0


class Sample(NamedTuple):
    """Statistics of a mean over runs or scenes; arrays of any common shape give the bounds of many means at once."""

    mean: Array
    error: Array
    """Standard error of the mean."""
    skewness: Array
    """Skewness of the values of single runs or scenes."""
    number: int
    scenes: bool = False

    @classmethod
    def of(cls, interval: Interval) -> Sample:
        """Return the mean, standard error and skewness of the runs or scenes from which an interval was computed."""
        influence = interval.corrected - interval.corrected.mean()
        variance = float((influence**2).mean())
        third = float((influence**3).mean()) / variance**1.5 if variance > 0 else 0.0
        value, error, skewness = (np.asarray(item) for item in (interval.value, interval.error or 0.0, third))
        return cls(value, error, skewness, len(influence), interval.scenes)

    @property
    def mirrored(self) -> Sample:
        """Statistics of the values with opposite sign."""
        return self._replace(mean=-self.mean, skewness=-self.skewness)

    def scaled(self, offset: float, factor: float) -> Sample:
        """Return the statistics of ``(value - offset) * factor``."""
        return self._replace(mean=(self.mean - offset) * factor, error=self.error * abs(factor))

    def above(self, level: float, skewness: Array, unseen: Array | float) -> Array:
        """Return the upper bound of the true mean minus the sample's mean, at a one-sided error probability.

        Student's t with the correction for skewness of Johnson (1978), "Modified t tests and confidence intervals for
        asymmetrical populations". A term for unseen runs is added: after ``number`` runs, a kind of run never seen may
        still make up ``-log(level) / number`` of all.

        Args:
            level: one-sided error probability.
            skewness: skewness of a single run's value.
            unseen: distance of unseen runs above the mean, in standard deviations of a run.
        """
        t, root = stdtrit(self.number - 1, 1 - level), self.number**0.5
        correction = np.maximum(skewness, 0.0) * (1 + 2 * t**2) / (6 * root)
        return np.asarray(self.error * (t + correction - unseen * np.log(level) / root))


def bound(interval: Interval, level: float, side: Side) -> float | None:
    """Return a one-sided bound that is wrong with probability ``level`` at most; None where no bound is calibrated.

    Runs and scenes of weight 0, such as those without an event, are left out.

    Args:
        interval: value with what each run or scene adds to it.
        level: one-sided error probability.
        side: ``lower`` or ``upper``.
    """
    if unbounded(interval):
        return None
    interval = interval.only(interval.telling)
    sample, low, high = Sample.of(interval), interval.at_least, interval.at_most
    if interval.counted == "rate" and interval.weight is not None:
        return float(rate_bound(sample, float(interval.weight.sum()) / interval.repeats, level, side))
    if _is_share(interval):
        counts = interval.counted == "share" and interval.weight is not None
        events = float(interval.weight.sum()) / interval.repeats if counts else np.inf  # type: ignore[union-attr]
        return low + (high - low) * float(share_bound(sample.scaled(low, 1 / (high - low)), level, side, events))
    if low < interval.value and np.isfinite(low):
        sample = sample.scaled(low, 1.0)
        return low + float(positive_bound(sample, level, side, interval.power))
    if interval.value < high and np.isfinite(high):
        other: Side = "lower" if side == "upper" else "upper"
        return high - float(positive_bound(sample.mirrored.scaled(-high, 1.0), level, other))
    return float(mean_bound(sample, level, side))


def unbounded(interval: Interval) -> str:
    """Return the reason why the value of an interval has no one-sided bound; empty where it has a bound."""
    has_weight = interval.telling
    interval = interval.only(has_weight)
    parts, rate = interval.parts, interval.counted == "rate"
    fewest = (2 if rate else 1) * (FEWEST_SCENES if parts.scenes else max(FEWEST_RUNS, parts.fewest))
    if parts.number < fewest:
        what = "scenes" if parts.scenes else "runs"
        if parts.number < len(has_weight):
            return f"{parts.number} of {len(has_weight)} {what} count, and no bound holds with fewer than {fewest:g}"
        return parts.uncalibrated or f"no bound holds with fewer than {fewest:g} {what}"
    return ALL_THE_SAME if interval.constant and not (rate or _is_share(interval)) else ""


def _is_share(interval: Interval) -> bool:
    return bool(np.isfinite(interval.at_most - interval.at_least)) and interval.power == 1.0


def interval_difference(a: Interval, b: Interval, *, same_runs: bool) -> Interval:
    """Return the difference ``a - b``; its bounds follow from how much each run or scene contributes to it.

    Args:
        a: first value.
        b: value to subtract.
        same_runs: whether run i of ``a`` has the same measurements as run i of ``b``, for each i.
    """
    if same_runs:
        has_weight = a.telling | b.telling
        # Runs without weight keep their place with 0, so that run i of both values stays run i.
        influence = np.zeros(len(has_weight))
        influence[has_weight] = (a.only(has_weight).corrected - b.only(has_weight).corrected) / has_weight.mean()
    else:
        a, b = (item.only(item.telling) for item in (a, b))
        number = len(a.influence) + len(b.influence)
        parts = a.corrected * number / len(a.influence), -b.corrected * number / len(b.influence)
        influence, has_weight = np.concatenate(parts), np.ones(number, dtype=bool)
    both = Interval(a.value - b.value, influence, weight=has_weight.astype(float), scenes=a.scenes, in_time=a.in_time)
    return both._replace(fewest=max(a.fewest, b.fewest))


def mean_bound(sample: Sample, level: float, side: Side) -> Array:
    """Return the one-sided bound of a mean whose values may have either sign."""
    if side == "lower":
        return -mean_bound(sample.mirrored, level, "upper")
    # Unseen runs matter less, the less skewed the values are: for normal ones Student's t is calibrated.
    unseen = UNSEEN_SCENES if sample.scenes else UNSEEN * np.minimum(0.3 + 0.7 * abs(sample.skewness), 1.0)
    return sample.mean + sample.above(level, SKEWNESS * sample.skewness, unseen)


def positive_bound(sample: Sample, level: float, side: Side, power: float = 1.0) -> Array:
    """Return the one-sided bound of a power of a mean of positive values.

    The lower bound is Student's bound of the logarithm, corrected where the sample is skewed towards zero. The upper
    bound corrects the mean for the sample's skewness, or for the skewness of lognormal values with the sample's
    coefficient of variation, whichever is larger.

    Args:
        sample: statistics of the power of the mean, by the delta method.
        level: one-sided error probability.
        side: ``lower`` or ``upper``.
        power: exponent on the mean, such as one half for a root mean square.
    """
    relative = sample._replace(error=sample.error / (power * sample.mean))
    if side == "lower":
        reach = relative.above(level, -SKEWNESS * sample.skewness, 0.0)
        return np.asarray(sample.mean * np.exp(-power * reach))
    variation = relative.error * sample.number**0.5
    usual = np.minimum(variation, LOGNORMAL)
    skewness = np.maximum(SKEWNESS * sample.skewness, 3 * usual + usual**3)
    above = relative.above(level, skewness, UNSEEN_SCENES if sample.scenes else UNSEEN * np.minimum(variation, 1.0))
    if sample.scenes and sample.number < -SEEN * np.log(level):
        above = above + RARE * (HARDER - 1)
    return np.asarray(sample.mean * (1 + above) ** power)


def share_bound(sample: Sample, level: float, side: Side, events: float = np.inf) -> Array:
    """Return the one-sided bound of a share of events, such as the share of missed warnings.

    For independent trials it is exact (Clopper and Pearson 1934, "The use of confidence or fiducial limits illustrated
    in the case of the binomial"). Where runs vary less than single trials would, the effective number of trials is
    used, reduced because its variance is estimated (Korn and Graubard 1998, "Confidence intervals for proportions with
    small expected number of positive counts estimated from cluster samples"). The upper bound
    of a share below 0.5 is then at least :func:`positive_bound`. In other cases a run counts as at most one trial.

    Args:
        sample: statistics of the share, 0 to 1.
        level: one-sided error probability.
        side: ``upper``, or ``lower``: 1 minus the upper bound of the opposite share.
        events: number of events that the share refers to, an upper limit of the trials; infinite if not counted.
    """
    if side == "lower":
        return 1 - share_bound(sample.mirrored.scaled(-1.0, 1.0), level, "upper", events)
    share, number = np.clip(sample.mean, 0.0, 1.0), sample.number
    varies = sample.error > 0
    spread = np.where(varies, sample.error, 1.0)
    trials = np.where(varies, share * (1 - share) / spread**2 * number / (number - 1), number)
    # Few runs may account for the whole share; their variance then does not measure the number of trials.
    few = share**2 < -2 * np.log(level) * spread**2
    several = varies & ~few & (trials > number * (1 + 1e-6))
    trials = np.minimum(np.where(several, trials * _variance_factor(level, number), np.minimum(trials, number)), events)
    hits, misses = share * trials, (1 - share) * trials
    exact = np.where(misses > 0, betaincinv(hits + 1, np.maximum(misses, 1e-9), 1 - level), 1.0)
    away = several & (share < 0.5)
    skewed = positive_bound(sample._replace(mean=np.where(away, share, 1.0)), level, "upper")
    return np.where(away, np.minimum(np.maximum(exact, skewed), 1.0), exact)


def rate_bound(sample: Sample, exposure: float, level: float, side: Side) -> Array:
    """Return the one-sided bound of a rate of events.

    It is Garwood's limit of a Poisson variable (1936, "Fiducial limits for the Poisson distribution"). Where runs or
    scenes vary more than Poisson variables, the number of events is divided by the dispersion, and the upper bound is
    at least :func:`positive_bound`.

    Args:
        sample: statistics of the rate.
        exposure: time or distance in which the events were counted, in the inverse unit of the rate.
        level: one-sided error probability.
        side: ``lower`` or ``upper``.
    """
    events = sample.mean * exposure
    dispersion = np.where(events > 0, sample.error**2 * exposure / np.where(events > 0, sample.mean, 1.0), 1.0)
    several = dispersion > 1
    few = 1 - 2 * np.log(level) / sample.number
    dispersion = np.where(several, dispersion * few / _variance_factor(level, sample.number), 1.0)
    events, exposures = events / dispersion, exposure / dispersion
    if side == "lower":
        return np.where(events > 0, gammaincinv(np.maximum(events, 1e-9), level), 0.0) / exposures
    limit: Array = gammaincinv(events + 1, 1 - level) / exposures
    skewed = positive_bound(sample._replace(mean=np.where(several, sample.mean, 1.0)), level, "upper")
    return np.where(several, np.maximum(limit, skewed), limit)


def _variance_factor(level: float, number: int) -> float:
    """Return the factor, below 1, on a number of trials whose variance is estimated from ``number`` runs."""
    return float(ndtri(1 - level) / stdtrit(number - 1, 1 - level)) ** 2
