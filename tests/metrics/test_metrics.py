"""Statistics by hand and against scipy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from tests.support.intervals import scaled

from trackbench.metrics.consistency import mean_bounds, normalised_square, point95
from trackbench.metrics.contrasts import paired, unpaired
from trackbench.metrics.differences import holm
from trackbench.metrics.intervals import ratio, root


def test_normalised_square_by_hand():
    covariance = np.array([[4.0, 0.0], [0.0, 9.0]])
    value, whitened, positive = normalised_square(np.array([2.0, -3.0]), covariance)
    assert value == pytest.approx(2.0)
    np.testing.assert_allclose(whitened, [1, -1])
    assert positive
    # With correlation: inverse of [[2, 1], [1, 2]] is [[2, -1], [-1, 2]] / 3.
    value, _, _ = normalised_square(np.array([1.0, 2.0]), np.array([[2.0, 1.0], [1.0, 2.0]]))
    assert value == pytest.approx((2 * 1 - 2 * 2 + 2 * 4) / 3)


def test_an_indefinite_covariance_is_told():
    stack = np.stack([np.eye(2), np.diag([1.0, -1.0])], axis=-1)
    np.testing.assert_array_equal(normalised_square(np.ones((2, 2)), stack)[2], [True, False])


def test_bounds_are_those_of_the_tables():
    # Bar-Shalom, Li and Kirubarajan (2001), section 5.4.2: 50 runs of a NEES of 2 degrees of freedom.
    low, high = mean_bounds(2, 50)
    assert (low, high) == (pytest.approx(74.22 / 50, abs=1e-3), pytest.approx(129.56 / 50, abs=1e-3))
    assert point95(2) == pytest.approx(5.991, abs=1e-3)
    assert point95(3) == pytest.approx(7.815, abs=1e-3)
    low, high = mean_bounds(4, np.array([1.0, 1e6]))
    np.testing.assert_allclose([low[1], high[1]], 4, atol=0.02)
    assert low[0] < 0.5
    assert high[0] > 11


def test_a_ratio_of_equal_counts_has_the_interval_of_a_mean():
    values = np.array([1.0, 4.0, 2.0, 7.0])
    found = ratio(5 * values, np.full(4, 5.0))
    assert found.value == pytest.approx(3.5)
    expected = stats.t.interval(0.95, 3, loc=3.5, scale=stats.sem(values))
    assert found.ci95 == pytest.approx(expected)


def test_the_interval_of_what_cannot_be_negative_is_that_of_its_logarithm():
    values = np.array([1.0, 4.0, 2.0, 7.0])
    found = ratio(5 * values, np.full(4, 5.0), at_least=0.0)
    expected = stats.t.interval(0.95, 3, loc=np.log(3.5), scale=stats.sem(values) / 3.5)
    assert np.log(found.ci95) == pytest.approx(expected)


def test_an_interval_that_few_runs_decide_reaches_further_by_half_their_skewness():
    values = np.array([1.0, 1.0, 1.0, 1.0, 6.0])
    plain = ratio(values, np.ones(5), at_least=0.0)
    low, high = plain._replace(skewed=True).ci95
    assert low == pytest.approx(plain.ci95[0])
    stretched = np.log(plain.ci95[1] / 2) * (1 + 0.5 * stats.skew(values) / np.sqrt(5))
    assert np.log(high / 2) == pytest.approx(stretched)
    # Away from a limit above, and nowhere where the long tail is on the side of the limit.
    mirrored = ratio(10 - values, np.ones(5), at_most=10.0)._replace(skewed=True)
    assert mirrored.ci95 == pytest.approx((10 - high, 10 - low))
    short = ratio(6.5 - values, np.ones(5), at_least=0.0)
    assert short._replace(skewed=True).ci95 == short.ci95


def test_the_interval_of_a_root_mean_square_is_the_root_of_that_of_the_mean_square():
    random = np.random.default_rng(5)
    mean_square = ratio(random.chisquare(3, 20), random.integers(1, 4, 20).astype(float), at_least=0.0)
    found = root(mean_square)
    assert found.value == pytest.approx(np.sqrt(mean_square.value))
    assert found.ci95 == pytest.approx(np.sqrt(mean_square.ci95))
    doubled = scaled(found, 2.0)
    assert doubled.value == pytest.approx(2 * found.value)
    assert doubled.ci95 == pytest.approx(tuple(2 * end for end in found.ci95))


def test_an_interval_never_starts_below_zero_and_is_finite():
    low, high = root(ratio(np.array([0.0, 1.0]), np.ones(2))).ci95
    assert 0.0 < low < high < np.inf
    nothing = root(ratio(np.zeros(3), np.ones(3)))
    assert (nothing.value, nothing.ci95) == (0.0, None)


def test_one_run_gives_a_value_and_no_interval():
    one = ratio(np.array([4.0]), np.array([2.0]))
    assert (one.value, one.ci95) == (2.0, None)
    assert root(one).ci95 is None
    difference = paired(one, one)
    assert (difference.ci95, difference.p_value) == (None, 1.0)


@given(st.integers(0, 10_000), st.integers(2, 40))
def test_paired_differences_of_means_are_those_of_scipy(seed, runs):
    random = np.random.default_rng(seed)
    common = random.normal(size=runs)
    a, b = common + 0.3 * random.normal(size=runs), common + 0.2 + 0.3 * random.normal(size=runs)
    expected = stats.ttest_rel(a, b)
    found = paired(ratio(a, np.ones(runs)), ratio(b, np.ones(runs)))
    assert found.value == pytest.approx(np.mean(a - b))
    assert found.p_value == pytest.approx(expected.pvalue, rel=1e-6)
    assert found.ci95 == pytest.approx(tuple(expected.confidence_interval()), rel=1e-6, abs=1e-9)


def test_paired_differences_of_root_mean_squares_are_near_those_of_the_runs():
    random = np.random.default_rng(3)
    runs, steps = 300, 200
    common = random.normal(size=(runs, steps))
    a, b = common + 0.3 * random.normal(size=(runs, steps)), 1.02 * common + 0.3 * random.normal(size=(runs, steps))
    squares = [(e**2).sum(axis=1) for e in (a, b)]
    found = paired(*(root(ratio(total, np.full(runs, float(steps)))) for total in squares))
    per_run = [np.sqrt(total / steps) for total in squares]
    expected = stats.ttest_rel(*per_run)
    assert found.value == pytest.approx(np.sqrt((a**2).mean()) - np.sqrt((b**2).mean()))
    assert found.ci95 == pytest.approx(tuple(expected.confidence_interval()), rel=0.1)
    assert found.p_value < 1e-6


@pytest.mark.parametrize("runs", [8, 20])
def test_intervals_of_skewed_sums_cover_as_often_as_they_say(runs):
    random = np.random.default_rng(8)
    inside = 0
    for _ in range(2000):
        squares = random.chisquare(4, runs) / 4
        low, high = root(ratio(squares, np.ones(runs))).ci95
        inside += low <= 1.0 <= high
    assert 1860 <= inside <= 1940


def test_the_interval_of_a_share_is_that_of_its_log_odds():
    hits, tries = np.array([48.0, 50.0, 44.0, 49.0]), np.full(4, 50.0)
    found = ratio(hits, tries, at_least=0.0, at_most=1.0)
    share = hits.sum() / tries.sum()
    slope = 1 / (share * (1 - share))
    expected = stats.t.interval(0.95, 3, loc=np.log(share / (1 - share)), scale=slope * stats.sem(hits / tries))
    assert [np.log(end / (1 - end)) for end in found.ci95] == pytest.approx(expected)
    missed = ratio(tries - hits, tries, at_least=0.0, at_most=1.0)
    assert missed.ci95 == pytest.approx((1 - found.ci95[1], 1 - found.ci95[0]))
    assert scaled(found, 100.0).ci95 == pytest.approx(tuple(100 * end for end in found.ci95))


def test_an_interval_keeps_to_a_limit_from_either_side():
    values = np.array([0.1, 0.9, 0.8, -0.6])
    below_one = ratio(values, np.ones(4), at_most=1.0)
    lost = ratio(1 - values, np.ones(4), at_least=0.0)
    assert below_one.ci95 == pytest.approx((1 - lost.ci95[1], 1 - lost.ci95[0]))
    above_one = ratio(2 - values, np.ones(4), at_least=1.0)
    assert above_one.ci95 == pytest.approx((1 + lost.ci95[0], 1 + lost.ci95[1]))


def test_runs_that_are_all_the_same_have_no_interval():
    none = ratio(np.zeros(10), np.full(10, 0.7), at_least=0.0)
    assert (none.value, none.ci95) == (0.0, None)
    assert "the same in every run" in none.as_value("1/min").reason
    shared = ratio(np.full(10, 0.3), np.full(10, 3.0))
    assert shared.ci95 is None
    # An event that no run shows may still happen with either.
    found = paired(none, none)
    assert (found.ci95, found.p_value, found.equivalent) == (None, 1.0, False)
    assert paired(none, ratio(np.arange(10.0), np.ones(10))).ci95 is not None


def test_a_difference_that_is_the_same_in_every_run_is_judged_by_its_sign():
    values = np.arange(1.0, 8.0)
    a, b = ratio(values, np.ones(7)), ratio(values + 1, np.ones(7))
    assert paired(a, b).p_value == pytest.approx(stats.binomtest(0, 7).pvalue)
    same = paired(a, a, 0.1)
    assert (same.ci95, same.p_value, same.equivalent) == ((0.0, 0.0), 1.0, True)
    constant = [ratio(np.full(7, value), np.ones(7)) for value in (0.1, 0.2)]
    assert paired(*constant).p_value == pytest.approx(2 * 0.5**7)
    assert unpaired(*constant).p_value == pytest.approx(2 * 0.5**7)


def test_holm_against_known_values():
    # Holm's own procedure on four tests: 0.01 * 4, 0.013 * 3, 0.02 * 2, 0.04 * 1, never decreasing.
    assert holm([0.01, 0.04, 0.013, 0.02]) == pytest.approx([0.04, 0.04, 0.04, 0.04])
    assert holm([0.001, 0.03, 0.02]) == pytest.approx([0.003, 0.04, 0.04])
    assert holm([0.6, 0.7]) == pytest.approx([1.0, 1.0])
    assert holm([0.02]) == [0.02]
    assert holm([]) == []
