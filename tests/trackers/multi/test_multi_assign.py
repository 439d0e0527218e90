"""The best assignment of detections to tracks, against all assignments written down and against a solver."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from trackbench.base.types import Array
from trackbench.trackers.multi.association import best_assignment


def listed(weight: Array) -> tuple[float, set[tuple[int, int]]]:
    """The largest sum of weights ``(T, D)`` and its pairs, by writing every assignment down."""
    tracks, detections = weight.shape
    best, chosen = 0.0, set()
    for choice in product(range(-1, detections), repeat=tracks):
        taken = [(t, d) for t, d in enumerate(choice) if d >= 0]
        if len({d for _, d in taken}) == len(taken) and all(weight[pair] > 0.0 for pair in taken):
            total = sum(weight[pair] for pair in taken)
            if total > best:
                best, chosen = total, set(taken)
    return best, chosen


@pytest.mark.parametrize("seed", range(60))
def test_the_sum_is_the_largest_of_all_assignments(seed: int) -> None:
    random = np.random.default_rng(seed)
    shape = random.integers(1, 5, 2)
    weight = np.where(random.random(shape) < random.uniform(0.3, 1.0), random.normal(1.0, 2.0, shape), -np.inf)
    track, detection = np.nonzero(np.isfinite(weight))
    chosen = best_assignment(track, detection, weight[track, detection], np.zeros(len(track), dtype=int))
    assert set(zip(track[chosen], detection[chosen], strict=True)) == listed(weight)[1]
    assert np.all(np.diff(chosen) > 0)


@pytest.mark.parametrize("share", [0.05, 0.2, 1.0])
def test_many_runs_are_assigned_as_a_solver_assigns_each(share: float) -> None:
    random = np.random.default_rng(3)
    runs, tracks, detections = 40, 8, 9
    gated = random.random((runs, tracks, detections)) < share
    run, own_track, own_detection = np.nonzero(gated)
    weight = random.normal(1.0, 2.0, len(run))
    chosen = best_assignment(run * tracks + own_track, run * detections + own_detection, weight, run)
    for number in range(runs):
        own = np.flatnonzero(run == number)
        value = np.zeros((tracks, detections))
        value[own_track[own], own_detection[own]] = np.maximum(weight[own], 0.0)
        rows, columns = linear_sum_assignment(value, maximize=True)
        expected = {(t, d) for t, d in zip(rows, columns, strict=True) if value[t, d] > 0.0}
        found = chosen[run[chosen] == number]
        assert set(zip(own_track[found], own_detection[found], strict=True)) == expected
