"""One-sided bounds at small levels: closed forms, invariances, and what is missed in simulations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from tests.support.intervals import scaled

from trackbench.metrics.intervals import Interval, ratio, root
from trackbench.subjects.envelope.bounds import (
    Sample,
    bound,
    interval_difference,
    mean_bound,
    positive_bound,
    share_bound,
    unbounded,
)

LEVELS = (0.05, 0.001, 1e-5)


def share(hits: int, number: int) -> Interval:
    """Of independent trials, each a run."""
    return ratio((np.arange(number) < hits).astype(float), np.ones(number), at_least=0.0, at_most=1.0)


@pytest.mark.parametrize(("hits", "number"), [(0, 100), (1, 100), (40, 100), (100, 100), (3, 1000)])
@pytest.mark.parametrize("level", LEVELS)
def test_the_bounds_of_independent_trials_are_those_at_which_the_binomial_tail_is_the_level(
    hits: int, number: int, level: float
) -> None:
    low, high = bound(share(hits, number), level, "lower"), bound(share(hits, number), level, "upper")
    assert high == 1.0 if hits == number else stats.binom.cdf(hits, number, high) == pytest.approx(level, rel=1e-6)
    assert low == 0.0 if hits == 0 else stats.binom.sf(hits - 1, number, low) == pytest.approx(level, rel=1e-6)


def rate(events: np.ndarray, hours: float) -> Interval:
    value = ratio(events.astype(float), np.full(len(events), hours / len(events)), at_least=0.0, scenes=True)
    return value._replace(counted="rate")


@pytest.mark.parametrize("level", LEVELS)
def test_the_bounds_of_a_rate_are_those_at_which_the_poisson_tail_is_the_level(level: float) -> None:
    few = np.zeros(60)
    # As far apart as Poisson variables, or less.
    few[[3, 17, 40]] = 1
    low, high = bound(rate(few, 5.0), level, "lower"), bound(rate(few, 5.0), level, "upper")
    assert stats.poisson.cdf(3, 5.0 * high) == pytest.approx(level, rel=1e-6)
    assert stats.poisson.sf(2, 5.0 * low) == pytest.approx(level, rel=1e-6)


def test_no_event_in_three_hours_of_different_scenes_is_less_than_one_an_hour() -> None:
    assert bound(rate(np.zeros(60), 3.0), 0.05, "upper") == pytest.approx(-np.log(0.05) / 3.0)
    assert bound(rate(np.zeros(60), 3.0), 0.05, "lower") == 0.0


def test_events_that_come_together_say_less_than_as_many_apart() -> None:
    apart, together = np.tile([1.0, 0.0, 0.0], 40), np.tile([6.0, *np.zeros(17)], 7)[:120]
    together *= apart.sum() / together.sum()
    for side, sign in (("lower", -1.0), ("upper", 1.0)):
        assert sign * bound(rate(together, 10.0), 0.001, side) > sign * bound(rate(apart, 10.0), 0.001, side)


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("side", ["lower", "upper"])
def test_the_bound_of_a_root_mean_square_is_the_root_of_that_of_the_mean_square(level: float, side) -> None:
    squares = np.random.default_rng(1).gamma(2.0, 1.0, 60)
    mean = ratio(squares, np.ones(60), at_least=0.0)
    assert bound(root(mean), level, side) == pytest.approx(np.sqrt(bound(mean, level, side)))
    assert bound(scaled(root(mean), 57.3), level, side) == pytest.approx(57.3 * np.sqrt(bound(mean, level, side)))


def test_what_is_at_most_one_has_the_bounds_of_its_distance_from_one_turned_round() -> None:
    values = np.random.default_rng(2).gamma(2.0, 1.0, 60)
    below = ratio(1.0 - values, np.ones(60), at_most=1.0)
    for side, other in (("lower", "upper"), ("upper", "lower")):
        assert bound(below, 0.001, side) == pytest.approx(
            1.0 - bound(ratio(values, np.ones(60), at_least=0.0), 0.001, other)
        )


def test_there_is_no_bound_of_too_few_or_of_what_is_the_same_in_every_run() -> None:
    few, same = ratio(np.arange(24.0), np.ones(24)), ratio(np.ones(50), np.ones(50), at_least=0.0)
    assert bound(few, 0.01, "upper") is None
    assert unbounded(few) == "no bound holds with fewer than 25 runs"
    assert unbounded(few._replace(influence=np.arange(29.0) - 14, weight=None, scenes=True)).endswith("30 scenes")
    assert bound(same, 0.01, "upper") is None
    assert "the same in every run" in unbounded(same)
    assert not unbounded(share(0, 50))


def test_a_paired_difference_has_the_deviation_of_the_differences_and_an_unpaired_one_both() -> None:
    random = np.random.default_rng(3)
    common, own = random.normal(size=(2, 100))
    a, b = (ratio(values, np.ones(100)) for values in (common + 0.1 * own, common))
    paired, unpaired = interval_difference(a, b, same_runs=True), interval_difference(a, b, same_runs=False)
    assert paired.value == unpaired.value == pytest.approx(0.1 * own.mean())
    assert paired.error == pytest.approx(0.1 * own.std(ddof=1) / 10)
    assert unpaired.error == pytest.approx(np.hypot(a.error, b.error), rel=0.01)


def drawn(values: np.ndarray) -> Sample:
    mean = values.mean(axis=1)
    offset = values - mean[:, None]
    variance = (offset**2).mean(axis=1)
    number = values.shape[1]
    skewness = (offset**3).mean(axis=1) / np.where(variance > 0, variance, 1.0) ** 1.5
    return Sample(mean, np.sqrt(variance / (number - 1)), skewness, number)


#: Mean one, but for the shares.
DRAWS = {
    "exponential": (positive_bound, lambda random, size: random.exponential(1.0, size), 1.0),
    "lognormal": (positive_bound, lambda random, size: random.lognormal(-0.125, 0.5, size), 1.0),
    "signed exponential": (mean_bound, lambda random, size: random.exponential(1.0, size), 1.0),
    "one in fifty": (share_bound, lambda random, size: (random.random(size) < 0.02).astype(float), 0.02),
    "shares": (share_bound, lambda random, size: random.beta(1.5, 28.5, size), 0.05),
}


@pytest.mark.parametrize("name", DRAWS)
@pytest.mark.parametrize("number", [25, 100])
def test_the_bounds_miss_no_more_often_than_their_level(name: str, number: int) -> None:
    bound_of, draw, truth = DRAWS[name]
    trials = 10_000
    sample = drawn(draw(np.random.default_rng(number), (trials, number)))
    for level in (0.05, 0.01, 0.001):
        for side, sign in (("lower", 1.0), ("upper", -1.0)):
            missed = int((sign * (bound_of(sample, level, side) - truth) > 0).sum())
            assert stats.binom.sf(missed - 1, trials, level) > 1e-4, (level, side, missed)


def test_scenes_without_an_event_do_not_count() -> None:
    events = (np.arange(200) < 40).astype(float)
    missed = np.zeros(200)
    counted = ratio(missed, events, at_least=0.0, at_most=1.0, scenes=True)._replace(counted="share")
    for level in LEVELS:
        # Of forty events, none missed.
        assert bound(counted, level, "upper") == pytest.approx(1.0 - level ** (1 / 40))
    few = ratio(missed, (np.arange(200) < 3).astype(float), at_least=0.0, at_most=1.0, scenes=True)
    assert bound(few, 0.01, "upper") is None
    assert unbounded(few) == "3 of 200 scenes count, and no bound holds with fewer than 30"


def test_a_share_of_events_has_no_more_trials_than_events() -> None:
    # Sixty scenes of two events each, in which every other is missed: no scene differs from another by much.
    events, missed = np.full(60, 2.0), np.array([1.0] * 58 + [0.0, 2.0])
    counted = ratio(missed, events, at_least=0.0, at_most=1.0, scenes=True)._replace(counted="share")
    assert bound(counted, 0.01, "upper") >= stats.beta.ppf(0.99, 61, 60) - 1e-9
