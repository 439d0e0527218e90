"""Verdicts on equal trackers in each world, on the committed table of scenes, with few trials."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.calibration import worlds

pytestmark = pytest.mark.slow
TRIALS = 150
#: Three times the Monte-Carlo error of 5 %.
ERROR = 3 * (0.05 * 0.95 / TRIALS) ** 0.5


@pytest.mark.parametrize(("world", "size"), [(world, of[0]) for world, of in worlds.SIZES.items()])
@pytest.mark.parametrize("metric", worlds.METRICS)
def test_an_equal_tracker_is_rarely_called_better_at_the_default_margin(world: str, metric: str, size: int) -> None:
    draws = np.random.default_rng(3).integers(0, len(worlds.pool(world)["count"]), (TRIALS, size))
    words, covered = worlds.verdicts(world, metric, draws, equal=True)
    assert np.isin(words["the default margin"], ("better", "worse")).mean(axis=0).max() <= worlds.MOST + ERROR
    # A scene of typical traffic that decides is not covered where it was not drawn, and pages say so.
    assert world == "typical" or covered.mean() >= 0.95 - ERROR


def test_a_tracker_that_is_much_better_is_called_so() -> None:
    """A rule that never shows anything would pass the test of equal trackers."""
    draws = np.random.default_rng(4).integers(0, len(worlds.pool("ideal")["count"]), (TRIALS, 20))
    words, _ = worlds.verdicts("ideal", "position", draws, equal=False)
    pair = worlds.PAIRS.index(("raw", "imm_cv_ca"))
    assert (words["the default margin"][:, pair] == "worse").mean() >= 0.95
