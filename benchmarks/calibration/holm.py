"""Differences corrected for their number"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import stats

from trackbench.metrics.differences import holm

from .claim import Claim, power, rate

TRIALS = 4000


def claims() -> Iterator[Claim]:
    """Of 15 pairs of six equal trackers, none is called different in 95 % of the comparisons (Holm 1979)."""
    random = np.random.default_rng(1)
    scores = random.normal(size=(TRIALS, 6, 30))
    wrong = np.array([min(own) < 0.05 for own in _corrected(scores)])
    yield rate("any of 15 differences between six equal trackers shown, 30 runs, Holm's correction", wrong, 0.0, 0.05)
    scores[:, 0] -= 1.0
    found = np.array([[p < 0.05 for p in own[:5]] for own in _corrected(scores)])
    what = "a tracker better than five others by the spread of a run shown to be so, of each of them"
    yield power(what, found.mean(axis=1), 0.6)


def _corrected(scores: np.ndarray) -> list[list[float]]:
    """Of the pairs of six trackers in each trial; those of the first come first."""
    first, second = np.triu_indices(6, 1)
    p_values = stats.ttest_1samp(scores[:, first] - scores[:, second], 0.0, axis=2).pvalue
    return [holm(row.tolist()) for row in p_values]
