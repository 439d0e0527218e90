"""Confidence limits of counted shares and rates, valid with few counted events and with none."""

from __future__ import annotations

from typing import Literal

from scipy.special import betaincinv, gammaincinv, ndtri, stdtrit

Counted = Literal["share", "rate"]


def count_limits(
    kind: Counted, value: float, amount: float, error: float, parts: int, stretch: float
) -> tuple[float, float]:
    """Return the 95 % limits of a share among counted events, or of a number of events per time.

    The limits are those of Clopper and Pearson (1934) for shares and of Garwood (1936) for rates. The events, or the
    time, are first divided by the factor by which parts vary more than independent counts: Korn and Graubard (1998),
    "Confidence intervals for proportions with small expected number of positive counts estimated from survey data",
    with their correction for few parts. If no event or every event counts, the interval has one limit, which gets the
    whole error probability of 5 %.

    Args:
        kind: share or rate.
        value: share from 0 to 1, or rate of at least 0.
        amount: number of events, or time; with several runs of one scene the mean over these runs, since another run is
            no new scene.
        error: standard error of the value from the variation between parts.
        parts: number of parts, which are runs or scenes.
        stretch: factor on the half width of an interval over few scenes, applied to the excess variance; 1 for runs.
    """
    count = value * amount
    independent = value * (1.0 - value) / amount if kind == "share" else value / amount
    factor = 1.0
    if independent > 0:
        # The variance of single counts is estimated with one degree of freedom less.
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
    """Return the number of independent trials that tell as much of a share as ``count`` dependent trials.

    It is ``count`` over the design effect, less for a variance that is known from few runs: Korn and Graubard (1998),
    "Confidence intervals for proportions with small expected number of positive counts estimated from cluster samples".
    It is 0 where the share is the same in every run, which says nothing about its variance.

    Args:
        share: share of hits among the trials.
        count: number of trials.
        reach: half width of the symmetric 95 % interval of the share.
    """
    variance = (reach / ndtri(0.975)) ** 2
    return min(share * (1.0 - share) / variance, count) if variance > 0 else 0.0


def share_interval(share: float, number: float) -> tuple[float, float]:
    """Return the exact 95 % interval of a share (Clopper and Pearson 1934); the number of trials may be fractional."""
    hits = share * number
    return _binomial_limits(hits, number - hits, 0.025)


def _binomial_limits(hits: float, misses: float, outside: float) -> tuple[float, float]:
    low = float(betaincinv(hits, misses + 1, outside)) if hits > 0 else 0.0
    return low, float(betaincinv(hits + 1, misses, 1.0 - outside)) if misses > 0 else 1.0
