"""T-GOSPA against every sequence of assignments, and against its definition in plain cases."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from tests.metrics.traffic.histories import counted_of, random_histories, tracks_of, truth_of

from trackbench.metrics.traffic import TrackHistory, TruthHistory
from trackbench.metrics.traffic import tgospa as tgospa_module
from trackbench.metrics.traffic.tgospa import tgospa

CUTOFF, SWITCH = 3.0, 1.5
NAN = np.nan


def enumerated(truth: TruthHistory, tracks: TrackHistory) -> float:
    """The smallest cost over all sequences of assignments, by the definition; squared."""
    x, y = truth.state[0], tracks.mean[0]
    objects, columns = x.shape[1], y.shape[1]
    vectors = [
        vector
        for vector in itertools.product(range(-1, columns), repeat=objects)
        if all(j < 0 or vector.count(j) == 1 for j in vector)
    ]

    def distance(k: int, vector: tuple[int, ...]) -> float:
        total, used = 0.0, {j for j in vector if j >= 0}
        for i, j in enumerate(vector):
            here = [not np.isnan(x[k, i]), j >= 0 and not np.isnan(y[k, j])]
            total += min(abs(x[k, i] - y[k, j]), CUTOFF) ** 2 if all(here) else sum(here) * CUTOFF**2 / 2
        return total + sum(CUTOFF**2 / 2 for j in range(columns) if j not in used and not np.isnan(y[k, j]))

    def changes(a: tuple[int, ...], b: tuple[int, ...]) -> float:
        return SWITCH**2 * sum(0.0 if i == j else 1.0 if min(i, j) >= 0 else 0.5 for i, j in zip(a, b, strict=True))

    best = {vector: distance(0, vector) for vector in vectors}
    for k in range(1, len(x)):
        best = {now: distance(k, now) + min(best[v] + changes(v, now) for v in vectors) for now in vectors}
    return min(best.values())


@pytest.mark.parametrize("seed", range(60))
def test_small_cases_equal_the_enumeration(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth, tracks = random_histories(
        rng, rng.integers(1, 8), rng.integers(1, 4), rng.integers(1, 4), rng.uniform(3, 12)
    )
    found = tgospa(counted_of(truth, tracks, CUTOFF), SWITCH)
    assert found.exact
    assert found.total == pytest.approx(enumerated(truth, tracks), rel=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_the_linear_program_is_at_most_the_exact_value_and_mostly_equal(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(seed)
    truth, tracks = random_histories(rng, 12, 4, 4, 9.0)
    counted = counted_of(truth, tracks, CUTOFF)
    exact = tgospa(counted, SWITCH)
    monkeypatch.setattr(tgospa_module, "LARGEST", 0)
    relaxed = tgospa(counted, SWITCH)
    assert relaxed.total <= exact.total * (1 + 1e-9)
    if relaxed.exact:
        assert relaxed.total == pytest.approx(exact.total, rel=1e-9)
    else:
        assert relaxed.total > 0.9 * exact.total


@pytest.mark.parametrize("seed", range(20))
def test_what_is_too_large_for_both_gets_an_upper_bound_near_the_exact_value(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth, tracks = random_histories(np.random.default_rng(seed), 12, 4, 4, 9.0)
    counted = counted_of(truth, tracks, CUTOFF)
    exact = tgospa(counted, SWITCH)
    monkeypatch.setattr(tgospa_module, "LARGEST", 0)
    monkeypatch.setattr(tgospa_module, "LARGEST_PROGRAM", 0)
    bound = tgospa(counted, SWITCH)
    assert exact.total * (1 - 1e-9) <= bound.total < 1.2 * exact.total
    assert not bound.exact or bound.total == pytest.approx(exact.total, rel=1e-9)


def test_one_switch_costs_one_switch() -> None:
    truth = truth_of([[0.0]] * 6)
    parts = tgospa(counted_of(truth, tracks_of([[0.0, NAN]] * 3 + [[NAN, 0.0]] * 3), CUTOFF), SWITCH)
    assert parts == (0.0, 0.0, 0.0, SWITCH**2, True)


def test_a_track_that_begins_late_costs_misses_but_no_switch() -> None:
    truth = truth_of([[0.0]] * 6)
    parts = tgospa(counted_of(truth, tracks_of([[NAN]] * 2 + [[1.0]] * 4), CUTOFF), SWITCH)
    assert parts == (4.0, 2 * CUTOFF**2 / 2, 0.0, 0.0, True)


def test_keeping_the_identity_is_cheaper_than_two_short_switches() -> None:
    truth = truth_of([[0.0, 2.0]] * 9)
    swapped = [[0.0, 2.0]] * 4 + [[1.1, 0.9]] + [[0.0, 2.0]] * 4
    parts = tgospa(counted_of(truth, tracks_of(swapped), CUTOFF), SWITCH)
    assert parts.switch == 0.0
    assert parts.localisation == pytest.approx(2 * 1.1**2)
