"""Differences corrected for their number"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import stats

from trackbench.metrics.intervals import holm

from .claim import Claim, rate

TRIALS = 4000


def claims() -> Iterator[Claim]:
    """Of 15 pairs of six equal trackers, none is called different in 95 % of the comparisons (Holm 1979)."""
    random = np.random.default_rng(1)
    scores = random.normal(size=(TRIALS, 6, 30))
    first, second = np.triu_indices(6, 1)
    p_values = stats.ttest_1samp(scores[:, first] - scores[:, second], 0.0, axis=2).pvalue
    wrong = np.array([min(holm(row.tolist())) < 0.05 for row in p_values])
    yield rate("any of 15 differences between six equal trackers shown, 30 runs, Holm's correction", wrong, 0.0, 0.05)
