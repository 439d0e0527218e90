"""One-sided confidence bounds of an :class:`~trackbench.metrics.intervals.Interval`, at levels down to 1e-5.

A map of many cells that is looked at several times leaves each look a level such as .00005. Student's t is far from
calibrated there: of exponentially distributed runs, 25 of them, it misses at 1e-4 fifty times as often.
``benchmarks/calibration/bounds.py`` measures what these bounds miss.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from scipy.special import betaincinv, gammaincinv, ndtri, stdtrit

from trackbench.base.types import Array
from trackbench.metrics.intervals import ALL_THE_SAME, Interval

Side = Literal["lower", "upper"]

#: Runs, and scenes, from which on there is a bound; of a rate twice as many, since few do not show how events gather.
FEWEST_RUNS, FEWEST_SCENES = 25, 30
#: By what the skewness of a sample is multiplied: that of a small sample is too small.
SKEWNESS = 1.3
#: Coefficient of variation up to which positive values are taken to be as skewed as lognormal ones.
LOGNORMAL = 1.3
#: By how many standard deviations what was not seen lies beyond the mean, of runs and of scenes.
UNSEEN, UNSEEN_SCENES = 2.0, 3.0
#: A kind of scenes that makes up this share of all, and is harder by this factor, is allowed for where too few scenes
#: were seen to have seen it: fewer than ``SEEN`` times minus the logarithm of the level.
RARE, HARDER, SEEN = 0.05, 10.0, 30.0


class Sample(NamedTuple):
    """What a mean over runs or scenes rests on. Each array may have any axes: the bounds of many are found at once."""

    mean: Array
    error: Array
    """Its standard error."""
    skewness: Array
    """Of the runs or scenes."""
    number: int
    scenes: bool = False

    @classmethod
    def of(cls, interval: Interval) -> Sample:
        """That of the mean of which the value is a power."""
        influence = interval.corrected - interval.corrected.mean()
        variance = float((influence**2).mean())
        third = float((influence**3).mean()) / variance**1.5 if variance > 0 else 0.0
        value, error, skewness = (np.asarray(item) for item in (interval.value, interval.error or 0.0, third))
        return cls(value, error, skewness, len(influence), interval.scenes)

    @property
    def mirrored(self) -> Sample:
        """That of the negative values."""
        return self._replace(mean=-self.mean, skewness=-self.skewness)

    def scaled(self, offset: float, factor: float) -> Sample:
        """That of ``(value - offset) * factor``."""
        return self._replace(mean=(self.mean - offset) * factor, error=self.error * abs(factor))

    def above(self, level: float, skewness: Array, unseen: Array | float) -> Array:
        """How far the mean may be above that of the sample.

        Student's t with the correction for skewness of Johnson (1978), "Modified t tests and confidence intervals for
        asymmetrical populations". To it is added what was not seen: a share of ``-log(level) / number`` of all runs may
        be of a kind of which none was drawn.

        Args:
            level: one-sided.
            skewness: of a run.
            unseen: by how many standard deviations of a run the unseen ones lie beyond.
        """
        t, root = stdtrit(self.number - 1, 1 - level), self.number**0.5
        correction = np.maximum(skewness, 0.0) * (1 + 2 * t**2) / (6 * root)
        return np.asarray(self.error * (t + correction - unseen * np.log(level) / root))


def bound(interval: Interval, level: float, side: Side) -> float | None:
    """The value is beyond the bound with a probability of at most ``level``; None where no bound is calibrated.

    Runs and scenes of weight 0, such as those without an event, do not count.

    Args:
        interval: a value and what each run, or scene, adds to it.
        level: the probability of an error, of this side alone.
        side: ``upper`` for what the value is at most.
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
    """Why there is no bound; empty where there is one."""
    there = interval.telling
    interval = interval.only(there)
    parts, rate = interval.parts, interval.counted == "rate"
    fewest = (2 if rate else 1) * (FEWEST_SCENES if parts.scenes else max(FEWEST_RUNS, parts.fewest))
    if parts.number < fewest:
        what = "scenes" if parts.scenes else "runs"
        if parts.number < len(there):
            return f"{parts.number} of {len(there)} {what} count, and no bound holds with fewer than {fewest:g}"
        return parts.uncalibrated or f"no bound holds with fewer than {fewest:g} {what}"
    return ALL_THE_SAME if interval.constant and not (rate or _is_share(interval)) else ""


def _is_share(interval: Interval) -> bool:
    return bool(np.isfinite(interval.at_most - interval.at_least)) and interval.power == 1.0


def interval_difference(a: Interval, b: Interval, *, same_runs: bool) -> Interval:
    """``a - b``.

    Args:
        a: of some runs or scenes.
        b: of the same, or of others.
        same_runs: whether the runs of ``a`` have the noise of those of ``b``, each the one in its place.
    """
    if same_runs:
        there = a.telling | b.telling
        # As many as there were, so that each is still that of its run.
        influence = np.zeros(len(there))
        influence[there] = (a.only(there).corrected - b.only(there).corrected) / there.mean()
    else:
        a, b = (item.only(item.telling) for item in (a, b))
        number = len(a.influence) + len(b.influence)
        parts = a.corrected * number / len(a.influence), -b.corrected * number / len(b.influence)
        influence, there = np.concatenate(parts), np.ones(number, dtype=bool)
    both = Interval(a.value - b.value, influence, weight=there.astype(float), scenes=a.scenes, in_time=a.in_time)
    return both._replace(fewest=max(a.fewest, b.fewest))


def mean_bound(sample: Sample, level: float, side: Side) -> Array:
    """Of a mean of values of either sign."""
    if side == "lower":
        return -mean_bound(sample.mirrored, level, "upper")
    # What was not seen matters as far as the sample is skewed at all: it does not of normal values.
    unseen = UNSEEN_SCENES if sample.scenes else UNSEEN * np.minimum(0.3 + 0.7 * abs(sample.skewness), 1.0)
    return sample.mean + sample.above(level, SKEWNESS * sample.skewness, unseen)


def positive_bound(sample: Sample, level: float, side: Side, power: float = 1.0) -> Array:
    """Of a power of a mean of positive values, skewed away from zero.

    Below it is Student's interval of the logarithm, which is the same whatever the power, corrected where the sample is
    skewed towards zero. Above, the mean itself has the skewness of the sample or, if that is larger, of lognormal
    values with its coefficient of variation.

    Args:
        sample: of the power of the mean, by the delta method.
        level: one-sided.
        side: of the bound.
        power: one half for a root mean square.
    """
    # Of the mean over its value.
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
    """Of a share: exact for that of independent trials (Clopper and Pearson 1934, "The use of confidence or fiducial
    limits illustrated in the case of the binomial").

    Where a run is more than one trial, they are as many as tell as much, with fewer for a variance that is known from
    few runs (Korn and Graubard 1998, "Confidence intervals for proportions with small expected number of positive
    counts estimated from cluster samples"); and the bound away from the nearer end is at least that of a positive mean,
    since runs may differ more than such trials. Where all runs are the same, or few have a share at all, each run is
    one trial. There are never more trials than events.

    Args:
        sample: of the share.
        level: one-sided.
        side: of the bound.
        events: that the share is of, where they are counted.
    """
    if side == "lower":
        return 1 - share_bound(sample.mirrored.scaled(-1.0, 1.0), level, "upper", events)
    share, number = np.clip(sample.mean, 0.0, 1.0), sample.number
    varies = sample.error > 0
    spread = np.where(varies, sample.error, 1.0)
    trials = np.where(varies, share * (1 - share) / spread**2 * number / (number - 1), number)
    # So many runs would vary as much if the others had nothing.
    few = share**2 < -2 * np.log(level) * spread**2
    several = varies & ~few & (trials > number * (1 + 1e-6))
    trials = np.minimum(np.where(several, trials * _known(level, number), np.minimum(trials, number)), events)
    hits, misses = share * trials, (1 - share) * trials
    exact = np.where(misses > 0, betaincinv(hits + 1, np.maximum(misses, 1e-9), 1 - level), 1.0)
    away = several & (share < 0.5)
    skewed = positive_bound(sample._replace(mean=np.where(away, share, 1.0)), level, "upper")
    return np.where(away, np.minimum(np.maximum(exact, skewed), 1.0), exact)


def rate_bound(sample: Sample, exposure: float, level: float, side: Side) -> Array:
    """Of a rate of events: Garwood's limits of a Poisson variable (1936, "Fiducial limits for the Poisson
    distribution"). Where the runs or scenes differ by more than Poisson variables do, the events are as many as tell as
    much; and the upper bound is at least that of a positive mean.

    Args:
        sample: of the rate.
        exposure: over which the events were counted, in the unit of one over the rate.
        level: one-sided.
        side: of the bound.
    """
    events = sample.mean * exposure
    dispersion = np.where(events > 0, sample.error**2 * exposure / np.where(events > 0, sample.mean, 1.0), 1.0)
    several = dispersion > 1
    few = 1 - 2 * np.log(level) / sample.number
    dispersion = np.where(several, dispersion * few / _known(level, sample.number), 1.0)
    events, exposures = events / dispersion, exposure / dispersion
    if side == "lower":
        return np.where(events > 0, gammaincinv(np.maximum(events, 1e-9), level), 0.0) / exposures
    limit: Array = gammaincinv(events + 1, 1 - level) / exposures
    skewed = positive_bound(sample._replace(mean=np.where(several, sample.mean, 1.0)), level, "upper")
    return np.where(several, np.maximum(limit, skewed), limit)


def _known(level: float, number: int) -> float:
    """By what a number of trials is multiplied whose variance is known from so many runs."""
    return float(ndtri(1 - level) / stdtrit(number - 1, 1 - level)) ** 2
