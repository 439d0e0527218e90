"""How much of the variance between runs is between their scenes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackbench.metrics.intervals import Interval


class VarianceShares(NamedTuple):
    """Where the variance of one run's value comes from; the two sum to one."""

    scene: float
    """Between scenes: the traffic."""
    noise: float
    """Between runs of one scene: the measurement noise."""


def variance_shares(interval: Interval, scene: NDArray[np.integer[Any]]) -> VarianceShares | None:
    """The variance components of a one-way random-effects model, by the ANOVA estimator, negative ones set to zero.

    Source: Searle, Casella and McCulloch (1992), "Variance components", section 3.6 (unequal numbers of runs).

    Args:
        interval: from runs, not clustered.
        scene: ``(runs,)`` the number of the scene of each.

    Returns:
        None where they cannot be told apart: one scene, one run in each, or the same value in every run.
    """
    scenes, index, counts = np.unique(scene, return_inverse=True, return_counts=True)
    runs = len(index)
    if not 1 < len(scenes) < runs:
        return None
    means = np.bincount(index, interval.influence) / counts
    within = float(((interval.influence - means[index]) ** 2).sum() / (runs - len(scenes)))
    between = float((counts * (means - interval.influence.mean()) ** 2).sum() / (len(scenes) - 1))
    size = (runs - (counts**2).sum() / runs) / (len(scenes) - 1)
    of_scene = max(0.0, (between - within) / size)
    total = of_scene + within
    return VarianceShares(of_scene / total, within / total) if total > 0 else None
