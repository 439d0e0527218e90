"""Sums over innovations: the correlation of successive ones against a loop over all pairs."""

from __future__ import annotations

import numpy as np
import pytest

from trackbench.metrics import innovations
from trackbench.metrics.innovations import Innovations
from trackbench.metrics.sums import NIS


def by_hand(white, used):
    """Pairs, products and squares at lags 0 and 1 of innovations ``(times, m, batch)`` that are ``used``."""
    found = np.zeros((3, 2))
    for later in range(len(white)):
        for lag in range(min(1, later) + 1):
            both = used[later] & used[later - lag]
            a, b = white[later][:, both], white[later - lag][:, both]
            found[:, lag] += [both.sum(), (a * b).sum(), (a * a).sum()]
    return found


def require_sums(found, white, used):
    expected = by_hand(white, used)
    np.testing.assert_allclose(found.per_run[3:6].sum(axis=1), expected[:, 1], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.per_run[:2].sum(axis=1), expected[[0, 2], 0], rtol=1e-12)


@pytest.mark.parametrize("chunk", [1, 3, 8, 20])
@pytest.mark.parametrize("share", [1.0, 0.7], ids=["every measurement", "some missing"])
def test_successive_innovations_have_the_sums_of_all_pairs(chunk, share, monkeypatch):
    monkeypatch.setattr(innovations, "CHUNK", chunk)
    random = np.random.default_rng(3)
    white, used = random.normal(size=(45, 2, 6)), random.random((45, 6)) < share
    white[~np.repeat(used[:, None], 2, axis=1)] = np.nan
    collected = Innovations(45, objects=2, runs=3)
    for item, valid in zip(white, used, strict=True):
        collected.add(item, valid, valid)
    found = collected.scores()
    require_sums(found, white, used)


def test_a_measurement_without_an_innovation_counts_in_no_pair():
    random = np.random.default_rng(4)
    white, used = random.normal(size=(31, 2, 4)), np.ones((31, 4), dtype=bool)
    missing = [0, 1, 12]
    used[missing] = False
    collected = Innovations(31, objects=1, runs=4)
    for k, item in enumerate(white):
        collected.add(None if k in missing else item, *[np.ones(4, dtype=bool)] * 2)
    found = collected.scores()
    require_sums(found, white, used)
    np.testing.assert_array_equal(np.flatnonzero(found.per_step[0] == 0), missing)
    np.testing.assert_array_equal(np.flatnonzero(found.per_step[NIS["missing"]]), missing)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e60])
def test_an_innovation_that_cannot_be_summed_does_not_count(bad):
    random = np.random.default_rng(5)
    white, used = random.normal(size=(45, 2, 6)), np.ones((45, 6), dtype=bool)
    for place in ((7, 3), (8, 3), (23, 0), (44, 5)):
        used[place] = False
        white[place[0], 1, place[1]] = bad
    collected = Innovations(45, objects=2, runs=3)
    for item in white:
        collected.add(item, *[np.ones(6, dtype=bool)] * 2)
    found = collected.scores()
    require_sums(found, white, used)
    np.testing.assert_array_equal(found.per_step[NIS["count"]], used.sum(axis=1))
    np.testing.assert_array_equal(found.per_step[NIS["missing"]], (~used).sum(axis=1))
