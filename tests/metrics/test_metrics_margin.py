"""Differences held against what does not matter."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from trackbench.metrics import BUILT_IN
from trackbench.metrics.contrasts import all_paired, paired, unpaired
from trackbench.metrics.differences import Family, contrast_verdict, holm, margin_between, tracker_differences
from trackbench.metrics.intervals import Interval, ratio, root
from trackbench.results.scenario_summary import MarginSummary

MARGIN = MarginSummary(percent=1.0, position_m=0.005, velocity_mps=0.02, course_deg=0.05)
ONES = np.ones(20)


def of(mean: float, spread: float, runs: int = 20) -> Interval:
    """A mean whose runs spread evenly about it."""
    noise = np.linspace(-1.0, 1.0, runs)
    return ratio(mean + spread * noise / noise.std(ddof=1), np.ones(runs))


def test_the_p_value_is_twice_the_one_sided_one_at_the_margin() -> None:
    a, b = of(1.3, 0.5), of(1.0, 0.0)
    found = paired(a, b, 0.1)
    error = 0.5 / np.sqrt(20)
    assert found.p_value == pytest.approx(2 * stats.t.sf((0.3 - 0.1) / error, 19))
    assert paired(b, a, 0.1).p_value == pytest.approx(found.p_value)
    assert paired(a, b, 0.31).p_value == 1.0
    assert paired(a, b).p_value == pytest.approx(2 * stats.t.sf(0.3 / error, 19))


@given(st.integers(0, 10_000), st.floats(0.0, 0.5), st.booleans())
def test_p_value_and_interval_agree(seed: int, margin: float, welch: bool) -> None:
    random = np.random.default_rng(seed)
    a, b = (ratio(random.normal(mean, 0.5, 12), np.ones(12)) for mean in (1.0, 1.3))
    found = (unpaired if welch else paired)(a, b, margin)
    low, high = found.ci95
    assert (found.p_value < 0.05) == (low > found.margin or high < -found.margin)
    assert found.equivalent == (-found.margin <= low and high <= found.margin)
    assert not (found.equivalent and found.p_value < 0.05)


@pytest.mark.parametrize(
    ("mean", "spread", "smaller", "larger", "neither"),
    [
        (0.8, 0.1, "better", "worse", "smaller"),
        (1.2, 0.1, "worse", "better", "larger"),
        (1.001, 0.001, "equivalent", "equivalent", "equivalent"),
        (1.001, 1.0, "undecided", "undecided", "undecided"),
        (1.02, 0.05, "undecided", "undecided", "undecided"),
    ],
)
def test_verdicts(mean: float, spread: float, smaller: str, larger: str, neither: str) -> None:
    found = paired(of(mean, spread), of(1.0, 0.0), 0.01)
    for better, expected in (("smaller", smaller), ("larger", larger), (None, neither)):
        assert contrast_verdict(found, found.p_value, better) == expected


def test_the_margin_is_the_larger_of_a_share_of_the_better_value_and_an_absolute_part() -> None:
    small, large = of(0.1, 0.0), of(2.0, 0.0)
    assert margin_between(small, large, "m", "smaller", MARGIN) == 0.005
    assert margin_between(large, of(3.0, 0.0), "m", "smaller", MARGIN) == pytest.approx(0.02)
    assert margin_between(small, large, "m", "larger", MARGIN) == pytest.approx(0.02)
    assert margin_between(small, large, "1", "smaller", MARGIN) == pytest.approx(0.001)
    assert margin_between(small, large, "m/s", None, MARGIN) == 0.02
    assert margin_between(small, large, "deg", None, MARGIN) == 0.05


def test_identical_trackers_are_equivalent_whatever_the_margin() -> None:
    nothing = MarginSummary(percent=0.0, position_m=0.0, velocity_mps=0.0, course_deg=0.0)
    same = root(of(0.25, 0.1))
    for margin in (MARGIN, nothing):
        trackers = {"a": {"position_rmse": same}, "b": {"position_rmse": same}}
        (found,) = tracker_differences(trackers, BUILT_IN, margin, {"a": {}, "b": {}})
        assert (found.verdict, found.better, found.p_value) == ("equivalent", None, 1.0)


PAIRS = list(combinations([f"t{i}" for i in range(4)], 2))


@pytest.mark.parametrize("runs", [1, 2, 37])
def test_all_pairs_at_once_are_each_pair_bit_for_bit(runs: int) -> None:
    random = np.random.default_rng(runs)
    several = [ratio(*random.uniform(1.0, 2.0, (2, runs))) for _ in range(5)]
    several.append(several[2])

    def margin(a: Interval, b: Interval) -> float:
        return 0.01 * min(a.value, b.value)

    each = [paired(a, b, margin(a, b)) for a, b in combinations(several, 2)]
    assert all_paired(several, list(combinations(range(6), 2)), margin) == each
    assert len({found.p_value for found in each}) > (5 if runs > 1 else 0)


def test_the_family_is_of_what_ranks_and_of_what_is_expected() -> None:
    random = np.random.default_rng(4)
    values = {
        f"t{i}": {
            path: ratio(random.normal(1.0 + 0.3 * i, 0.3, 20), ONES) for path in ("position_rmse", "velocity_rmse")
        }
        for i in range(4)
    }

    def judged(family: Family) -> dict[tuple[str, str, str], float]:
        items = tracker_differences(values, BUILT_IN, MARGIN, {name: {} for name in values}, family)
        assert {item.verdict is None for item in items if item.p_value is None} == {True}
        return {(item.metric, item.a, item.b): item.p_value for item in items if item.p_value is not None}

    position = {name: own["position_rmse"] for name, own in values.items()}
    margins = {(a, b): 0.01 * min(position[a].value, position[b].value) for a, b in PAIRS}
    alone = {(a, b): paired(position[a], position[b], margin).p_value for (a, b), margin in margins.items()}
    every = judged(Family())
    assert list(every) == [("position_rmse", *pair) for pair in PAIRS]
    assert list(every.values()) == pytest.approx(holm(list(alone.values())))
    stated = Family(expected=[("velocity_rmse", frozenset(("t3", "t1")))])
    assert list(judged(stated))[-1] == ("velocity_rmse", "t1", "t3")
    assert min(judged(stated).values()) == pytest.approx(7 * min(alone.values()))
    baseline = judged(Family("t1"))
    assert list(baseline) == [("position_rmse", "t1", name) for name in ("t0", "t2", "t3")]
    assert baseline["position_rmse", "t1", "t3"] == pytest.approx(3 * alone["t1", "t3"])
    # As of all pairs at first: 4 trackers, each of which may be worse than any of 3.
    best = judged(Family("t0", selected=True))
    assert best["position_rmse", "t0", "t3"] == pytest.approx(6 * alone["t0", "t3"])
    assert best["position_rmse", "t0", "t2"] == pytest.approx(3 * 3 / 2 * alone["t0", "t2"])
