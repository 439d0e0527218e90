"""Limits of counted shares and rates, against exact ones and by simulation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from trackbench.metrics.intervals import clustered, ratio


def rate(counts: np.ndarray, hours: np.ndarray, scene: np.ndarray) -> tuple[float, float]:
    interval = clustered(ratio(counts, hours, at_least=0.0)._replace(counted="rate"), scene)
    assert interval.ci95 is not None
    return interval.ci95


def test_none_in_three_hours_of_different_scenes_is_less_than_one_an_hour():
    low, high = rate(np.zeros(30), np.full(30, 0.1), np.arange(30))
    assert low == 0.0
    assert high == pytest.approx(-np.log(0.05) / 3.0)
    assert 0.99 < high < 1.0


def test_more_runs_of_the_same_scenes_are_no_more_hours():
    once = rate(np.zeros(30), np.full(30, 0.1), np.arange(30))
    assert rate(np.zeros(300), np.full(300, 0.1), np.repeat(np.arange(30), 10)) == pytest.approx(once)


def test_alike_scenes_give_the_limits_of_garwood():
    counts = np.tile([0.0, 1.0], 20)
    low, high = rate(counts, np.full(40, 0.5), np.arange(40))
    assert low == pytest.approx(stats.chi2.ppf(0.025, 40) / 2 / 20)
    assert high == pytest.approx(stats.chi2.ppf(0.975, 42) / 2 / 20)


@pytest.mark.parametrize("missed", [0, 1, 7, 20])
def test_one_event_a_run_gives_the_limits_of_clopper_and_pearson(missed: int):
    total = np.where(np.arange(20) < missed, 1.0, 0.0)
    low, high = ratio(total, np.ones(20), at_least=0.0, at_most=1.0)._replace(counted="share").ci95
    exact = stats.binomtest(missed, 20).proportion_ci(0.95 if 0 < missed < 20 else 0.9)
    assert (low, high) == pytest.approx((exact.low, exact.high))


@pytest.mark.parametrize("shape", [np.inf, 1.0])
def test_the_limits_of_a_rate_hold_where_scenes_differ(shape: float):
    """Counts of scenes are Poisson, or with a rate of each that is drawn from a gamma distribution."""
    random, repeats, scenes, mean = np.random.default_rng(4), 2000, 40, 0.5
    rates = mean if shape == np.inf else random.gamma(shape, mean / shape, size=(repeats, scenes))
    counts = random.poisson(rates, size=(repeats, scenes)).astype(float)
    scene, hours = np.arange(scenes), np.ones(scenes)
    ends = [rate(row, hours, scene) for row in counts]
    below = np.mean([high < mean for _, high in ends])
    above = np.mean([low > mean for low, _ in ends])
    assert below < 0.04
    assert above < 0.04
