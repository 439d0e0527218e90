"""Limits of shares and rates that are counted: they hold with few counts, and without any."""

from __future__ import annotations

from typing import Literal

from scipy.special import betaincinv, gammaincinv, ndtri, stdtrit

Counted = Literal["share", "rate"]


def count_limits(
    kind: Counted, value: float, amount: float, error: float, parts: int, stretch: float
) -> tuple[float, float]:
    """The 95 % limits of a share of so many events, or of a rate over so much time.

    They are those of Clopper and Pearson (1934) and of Garwood (1936) for fewer events, or less time, by the factor by
    which the parts, runs or scenes, differ more than independent counts do: Korn and Graubard (1998), "Confidence
    intervals for proportions with small expected number of positive counts estimated from survey data", with their
    correction for few parts. Without any count, or with nothing else, there is one limit, and all 5 % are spent on it.

    Args:
        kind: what it is.
        value: from 0 to 1 of a share; at least 0 of a rate.
        amount: number of events, or time. Of several runs of one scene the mean: another run is no new scene.
        error: standard error of the value from how the parts differ.
        parts: their number.
        stretch: of the reach of an interval over so many scenes, which the excess is stretched by; 1 of runs.
    """
    count = value * amount
    independent = value * (1.0 - value) / amount if kind == "share" else value / amount
    factor = 1.0
    if independent > 0:
        # The variance of single counts is estimated with one less.
        excess = error**2 / independent * (parts - 1) / parts - 1.0
        few = stdtrit(parts - 1, 0.975) / ndtri(0.975)
        factor += max(0.0, excess) * (few * stretch) ** 2
    count, amount = count / factor, amount / factor
    rest = amount - count if kind == "share" else 1.0
    outside = 0.025 if count > 0 and rest > 0 else 0.05
    if kind == "rate":
        low = float(gammaincinv(count, outside)) / amount if count > 0 else 0.0
        return low, float(gammaincinv(count + 1.0, 1.0 - outside)) / amount
    return _binomial_limits(count, rest, outside)


def effective_number(share: float, count: float, reach: float) -> float:
    """How many independent trials would tell as much of a share as ``count`` dependent ones; at most ``count``.

    The number over the design effect, with fewer for a variance that is known from few runs: Korn and Graubard (1998),
    "Confidence intervals for proportions with small expected number of positive counts estimated from cluster samples".
    0 where the share is the same in every run, which says nothing of its variance.

    Args:
        share: of the trials.
        count: number of trials.
        reach: of the share, half of the symmetric 95 % interval.
    """
    variance = (reach / ndtri(0.975)) ** 2
    return min(share * (1.0 - share) / variance, count) if variance > 0 else 0.0


def share_interval(share: float, number: float) -> tuple[float, float]:
    """The exact 95 % interval of a share of so many independent trials, which need not be whole: Clopper and Pearson
    (1934), "The use of confidence or fiducial limits illustrated in the case of the binomial"."""
    hits = share * number
    return _binomial_limits(hits, number - hits, 0.025)


def _binomial_limits(hits: float, misses: float, outside: float) -> tuple[float, float]:
    low = float(betaincinv(hits, misses + 1, outside)) if hits > 0 else 0.0
    return low, float(betaincinv(hits + 1, misses, 1.0 - outside)) if misses > 0 else 1.0
