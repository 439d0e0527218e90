"""Mean ranks over scenarios: how well they are known, and which of them differ.

The population are scenarios of the kind of those compared, each with as many runs. The parameter is a tracker's
expected rank in one of them, as its runs would show it. The ranks of one scenario hold the noise of its runs, and those
of different scenarios are independent, so the spread over scenarios has both in it: the choice of scenarios, and the
noise within each.
"""

from __future__ import annotations

import numpy as np

from trackbench.base.distributions import t_quantile
from trackbench.base.types import Array
from trackbench.metrics.differences import LEVEL

#: Of a scenario, in which every tracker has the middle rank, that is added for the interval.
PSEUDO = 0.5
#: Fewer make no interval of 95 %: ranks then take so few values that an interval covers anything from 60 to 100 %.
FEWEST_SCENARIOS, FEWEST_TRACKERS = 3, 4
#: With more scenarios the signs are drawn.
ALL_SIGNS = 14
DRAWN_SIGNS = 20_000


def interval(ranks: Array, trackers: int) -> tuple[float, float] | None:
    """The 95 % interval of a tracker's mean rank; None with fewer than 3 scenarios or 4 trackers.

    Student's t with half a scenario added in which the tracker has the middle rank. Without it a tracker that is first
    in each of a few scenarios would seem to be so in all there are. The idea is that of Agresti and Coull (1998),
    "Approximate is better than exact for interval estimation of binomial proportions".

    Args:
        ranks: ``(scenarios,)`` of the tracker.
        trackers: how many are ranked.
    """
    if len(ranks) < FEWEST_SCENARIOS or trackers < FEWEST_TRACKERS:
        return None
    middle = (trackers + 1) / 2
    size = len(ranks) + PSEUDO
    mean = (ranks.sum() + PSEUDO * middle) / size
    variance = (((ranks - mean) ** 2).sum() + PSEUDO * (middle - mean) ** 2) / (size - 1)
    reach = t_quantile(0.975, size - 1) * np.sqrt(variance / size)
    return float(max(mean - reach, 1.0)), float(min(mean + reach, trackers))


def sign_flip(differences: Array) -> Array:
    """``(pairs,)`` two-sided p-values of the hypothesis that the two trackers of a pair have the same expected rank.

    If they have, which of them is called the first in a scenario does not matter, so each difference could as well have
    the other sign: the p-value is the share of all choices of signs whose sum is at least as far from zero. That is
    exact for trackers that are alike, however few scenarios there are, and no smaller than 2 to the power of 1 -
    scenarios. Source: Fisher (1935), "The Design of Experiments", section 21; with drawn signs Phipson and Smyth
    (2010), "Permutation p-values should never be zero".

    Args:
        differences: ``(pairs, scenarios)`` of the ranks of two trackers; 0 where one of them did not take part.
    """
    scenarios = differences.shape[1]
    if scenarios <= ALL_SIGNS:
        signs = 1.0 - 2.0 * (np.arange(2**scenarios)[:, None] >> np.arange(scenarios) & 1)
    else:
        drawn = np.random.default_rng(0).choice([1.0, -1.0], (DRAWN_SIGNS, scenarios))
        signs = np.vstack([np.ones(scenarios), drawn])
    observed = np.abs(differences.sum(axis=1, keepdims=True))
    # The same sum in another order must not count as smaller.
    shares: Array = (np.abs(differences @ signs.T) >= observed - 1e-9).mean(axis=1)
    return shares


def fewest_scenarios(trackers: int) -> int:
    """With fewer scenarios no difference can be shown between two of these trackers, whatever the ranks."""
    pairs = trackers * (trackers - 1) / 2
    return next(count for count in range(1, 100) if pairs * 2.0 ** (1 - count) < LEVEL)
