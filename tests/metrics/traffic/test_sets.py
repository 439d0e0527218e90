"""GOSPA against Stone Soup and closed forms."""

from __future__ import annotations

import datetime

import numpy as np
import pytest
from stonesoup.metricgenerator.ospametric import GOSPAMetric
from stonesoup.types.state import State
from tests.metrics.traffic.histories import counted_of, random_histories
from tests.support.gospa import gospa_of_sets

from trackbench.base.types import Array
from trackbench.metrics.traffic.set_distances import GospaParts, gospa

NOW = datetime.datetime(2000, 1, 1)


def sets(seed: int) -> tuple[Array, Array, float]:
    """Positions ``(2, T, N)`` and ``(2, T, K)`` of objects and tracks, some of them absent, and a cutoff."""
    rng = np.random.default_rng(seed)
    found = []
    for size in rng.integers(1, 8, 2):
        positions = rng.uniform(0, 20, (2, 10, size))
        positions[:, rng.random((10, size)) < 0.2] = np.nan
        found.append(positions)
    return found[0], found[1], float(rng.uniform(2, 15))


def states(positions: Array) -> list[State]:
    return [State(column[:, None], timestamp=NOW) for column in positions.T if np.isfinite(column[0])]


@pytest.mark.parametrize("p", [1.0, 2.0])
@pytest.mark.parametrize("seed", range(15))
def test_gospa_equals_stone_soup(seed: int, p: float) -> None:
    objects, tracks, cutoff = sets(seed)
    parts = gospa_of_sets(objects, tracks, cutoff, p)
    for k in range(objects.shape[1]):
        there, found = states(objects[:, k]), states(tracks[:, k])
        if not there and not found:
            assert parts.total[k] == 0
            continue
        theirs = GOSPAMetric(p=p, c=cutoff).compute_gospa_metric(found, there)[0].value
        assert parts.total[k] ** (1 / p) == pytest.approx(theirs["distance"], rel=1e-9)
        for name in ("localisation", "missed", "false"):
            assert getattr(parts, name)[k] == pytest.approx(theirs[name], rel=1e-9, abs=1e-9)


def test_one_missed_object_and_one_false_track_cost_half_of_the_cutoff_each() -> None:
    for p in (1.0, 2.0, 3.0):
        missed = gospa_of_sets(np.zeros((2, 1, 1)), np.full((2, 1, 1), np.nan), 5.0, p)
        assert missed.total ** (1 / p) == pytest.approx((5.0**p / 2) ** (1 / p))
        assert missed == GospaParts(np.zeros(1), np.array([5.0**p / 2]), np.zeros(1))
        false = gospa_of_sets(np.full((2, 1, 1), np.nan), np.zeros((2, 1, 1)), 5.0, p)
        assert false == GospaParts(np.zeros(1), np.zeros(1), np.array([5.0**p / 2]))


def test_nothing_is_no_distance() -> None:
    nothing = np.full((2, 3, 2), np.nan)
    assert not gospa_of_sets(nothing, nothing, 5.0).total.any()


def test_scores_of_histories_are_those_of_their_sets() -> None:
    truth, tracks = random_histories(np.random.default_rng(1), 40, 5, 6, 20.0)
    counted = counted_of(truth, tracks, 4.0)
    there = np.where(tracks.ids >= 0, tracks.mean[:2], np.nan)
    expected = gospa_of_sets(np.where(truth.status > 0, truth.state[:2], np.nan), there, 4.0)
    parts = gospa(counted)
    for ours, theirs in zip(parts, expected, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-12)
