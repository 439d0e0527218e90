"""Verdicts on the tails of the NEES, and on errors along and across the motion."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.calibration.tails import INSTANTS, alternating, matched, nees_of, small
from scipy.special import gammaincinv

from trackbench.metrics.consistency import DIRECTIONS
from trackbench.metrics.count_intervals import effective_number
from trackbench.metrics.covariance_words import verdict_in_words
from trackbench.metrics.intervals import reach_of_ratio
from trackbench.metrics.verdicts import (
    heavy_beside,
    judged_parts,
    meaning,
    overall_verdict,
    tail_limits,
    tail_verdict,
    what_is_off,
)
from trackbench.results import ConditionScores, ConditionVerdict, MetricValue, PartVerdict


def judged(filtered, runs, over_time=0.5, common=0.0, seed=1):
    return nees_of(filtered, np.random.default_rng(seed), runs, over_time, common)


@pytest.mark.parametrize("over_time", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("runs", [10, 20, 100])
def test_a_matched_filter_is_consistent(runs, over_time):
    nees = judged(matched, runs, over_time)
    assert nees.verdict == "consistent"
    names = [part.name for part in nees.parts]
    assert names[0] == "beyond the 95 % point"
    # Ten runs whose errors last are too few for the 99.9 % point.
    far = {"beyond the 99 % point"} if runs == 10 and over_time == 0.9 else {"beyond the 99.9 % point"}
    assert names[1] in far | ({"beyond the 99 % point"} if runs < 100 else set())
    assert names[2:] == list(DIRECTIONS)


def with_outliers(variance):
    """2 % of the NEES beyond the 99.9 % point, the others of normal errors over this variance."""

    def filtered(errors):
        nees = (errors**2).sum(axis=0)
        outlier = nees > OUTERMOST
        return errors * np.where(outlier, np.sqrt(1.1 * FARTHEST * variance / nees), 1.0), np.full(INSTANTS, variance)

    return filtered


#: Of chi-square with four degrees of freedom, the points beyond which are 2 % and 0.1 %.
OUTERMOST, FARTHEST = (float(2 * gammaincinv(2, share)) for share in (0.98, 0.999))


@pytest.mark.parametrize(
    ("filtered", "verdict", "words"),
    [
        (with_outliers(2.0), "pessimistic", "too large, outliers"),
        (with_outliers(0.85), "optimistic", "too small, outliers"),
        (small, "optimistic", "too small"),
        (alternating, "heavy-tailed", "about right, outliers"),
        (matched, "consistent", "about right"),
    ],
)
def test_a_mean_that_is_off_hides_no_tails_beyond_what_it_explains(filtered, verdict, words):
    nees = judged(filtered, 100)
    assert nees.verdict == verdict
    assert verdict_in_words(nees) == words
    assert nees.model_dump(mode="json").get("also") == ("heavy-tailed" if nees.also else None)


@pytest.mark.parametrize(
    ("word", "mean", "low", "also"),
    [
        ("pessimistic", 3.0, 0.004, "heavy-tailed"),
        ("mixed", 4.0, 0.0041, "heavy-tailed"),
        ("optimistic", 5.0, 0.0041, None),
        ("optimistic", 5.0, 0.02, "heavy-tailed"),
        ("consistent", 4.0, 0.02, None),
        ("heavy-tailed", 4.0, 0.02, None),
    ],
)
def test_a_share_is_held_against_what_the_mean_explains(word, mean, low, also):
    """Of a covariance off by the factor of the mean and 20 %: 0.4 % beyond the 99.9 % point of a mean of 4, 1.5 %
    of one of 5."""
    far = PartVerdict(
        name="beyond the 99.9 % point", value=low, expected=0.001, ci95=(low, 2 * low), verdict="heavy-tailed"
    )
    assert heavy_beside(word, mean, [], [far]) == also


@pytest.mark.parametrize(("factors", "first"), [((1.45, 0.5, 1.0, 1.0), 0), ((1.0, 1.0, 1.45, 0.5), 2)])
def test_errors_too_large_along_and_too_small_across_are_mixed(factors, first):
    """Of the position, and of the velocity."""

    def turned(errors):
        """Along and across are what they are whatever the course, so that the error is scaled in the fixed frame of an
        object that moves along x."""
        return errors * np.reshape(factors, (4, 1, 1, 1)), np.ones(errors.shape[1])

    nees = nees_of(turned, np.random.default_rng(1), 100, 0.5, course=0.0)
    assert nees.verdict == "mixed"
    along, across = nees.parts[2 + first : 4 + first]
    assert along.name.endswith("along the motion")
    assert {part.verdict for part in nees.parts[4 - first : 6 - first]} == {"consistent"}
    assert (along.verdict, across.verdict) == ("optimistic", "pessimistic")
    assert along.value == pytest.approx(1.45**2, rel=0.03)
    assert across.value == pytest.approx(0.25, rel=0.03)
    assert "along the motion (1 expected)" in what_is_off(nees)


@pytest.mark.parametrize(
    ("point", "below", "above"),
    [("95 %", 0.1, 0.1), ("99 %", None, 0.2), ("99.9 %", None, 0.2)],
)
def test_limits_of_a_share_are_those_of_a_covariance_off_by_what_is_tolerated(point, below, above):
    place = 2 * gammaincinv(2, float(point[:-2]) / 100)

    def share(factor):
        """Of chi-square with four degrees of freedom times a factor: in closed form."""
        half = place / factor / 2
        return np.exp(-half) * (1 + half)

    low = 0.0 if below is None else share(1 - below)
    assert tail_limits(point) == pytest.approx((low, share(1 + above)))
    low = 0.0 if below is None else share(0.75)
    assert tail_limits(point, under_condition=True) == pytest.approx((low, share(1.5)))


@pytest.mark.parametrize(
    ("ci95", "point", "expected"),
    [
        ((0.04, 0.07), "95 %", "consistent"),
        ((0.06, 0.08), "95 %", "undecided"),
        ((0.08, 0.12), "95 %", "heavy-tailed"),
        ((0.01, 0.03), "95 %", "pessimistic"),
        ((0.0, 0.0002), "99.9 %", "consistent"),
        ((0.003, 0.006), "99.9 %", "undecided"),
        ((0.004, 0.006), "99.9 %", "heavy-tailed"),
    ],
)
def test_verdicts_on_a_share(ci95, point, expected):
    assert tail_verdict(ci95, point) == expected


def part(verdict):
    return PartVerdict(name="beyond the 95 % point", value=0.1, expected=0.05, ci95=(0.09, 0.11), verdict=verdict)


@pytest.mark.parametrize(
    ("whole", "over_all", "under", "expected"),
    [
        ("consistent", "consistent", "consistent", "consistent"),
        ("consistent", "undecided", "consistent", "undecided"),
        ("consistent", "consistent", "undecided", "consistent"),
        ("consistent", "heavy-tailed", "consistent", "heavy-tailed"),
        ("undecided", "heavy-tailed", "undecided", "heavy-tailed"),
        ("consistent", "consistent", "heavy-tailed", "heavy-tailed"),
        ("optimistic", "heavy-tailed", "heavy-tailed", "optimistic"),
        ("pessimistic", "heavy-tailed", "consistent", "pessimistic"),
        ("optimistic", "pessimistic", "consistent", "optimistic"),
        ("pessimistic", "optimistic", "consistent", "pessimistic"),
        ("consistent", "pessimistic", "consistent", "mixed"),
        ("consistent", "heavy-tailed", "optimistic", "mixed"),
    ],
)
def test_the_mean_comes_before_mixed_and_mixed_before_the_tails(whole, over_all, under, expected):
    condition = ConditionVerdict(name="any", mean=4.0, ci95=(3.9, 4.1), verdict="consistent", parts=(part(under),))
    assert overall_verdict(4.0, whole, [condition], [part(over_all)]) == expected


def test_the_tails_count_only_where_most_estimates_are_given():
    share = MetricValue(value=0.1, unit="1", ci95=(0.09, 0.11))
    scores = ConditionScores(count=1000, given=980, runs=10, metrics={"nees_beyond.95": share})
    assert [part.verdict for part in judged_parts(scores)] == ["undecided"]
    assert judged_parts(ConditionScores(count=1000, given=1000, runs=10)) == []


def test_leaving_out_what_is_beyond_a_point_does_not_make_its_share_right():
    """0.8 % of the estimates moves no mean, and is twice what may be beyond the 99.9 % point."""
    none = MetricValue(value=0.0009, unit="1", ci95=(0.0007, 0.0012))
    nees = MetricValue(value=4.0, unit="1", dof=4, ci95=(3.95, 4.05))
    near = MetricValue(value=0.05, unit="1", ci95=(0.048, 0.052))
    every = ConditionScores(
        count=100_000, given=100_000, runs=100, metrics={"nees": nees, "nees_beyond.95": near, "nees_beyond.99.9": none}
    )
    silent = every.model_copy(update={"given": 99_200})
    assert [part.verdict for part in judged_parts(every)] == ["consistent", "consistent"]
    assert [part.verdict for part in judged_parts(silent)] == ["consistent", "undecided"]
    assert judged_parts(silent)[1].ci95 == pytest.approx((0.0007 * 0.992, 0.0012 * 0.992 + 0.008))
    undecided = MetricValue(value=4.0, unit="1", dof=4, verdict="undecided")
    assert meaning(undecided, {"": silent}).endswith("large errors are as frequent as stated: 99.2 % given")
    assert meaning(undecided, {"": every}).startswith("too few runs or scenes")


def test_the_effective_number_of_clusters_is_that_of_clusters():
    """Runs of 50 estimates that are all beyond or all not tell as much as one estimate each."""
    random = np.random.default_rng(2)
    beyond = 50.0 * (random.random(4000) < 0.2)
    each = np.full(4000, 50.0)
    reach = reach_of_ratio(beyond.sum(), each.sum(), (beyond**2).sum(), (beyond * each).sum(), (each**2).sum(), 4000)
    share = beyond.sum() / each.sum()
    assert effective_number(share, each.sum(), reach) == pytest.approx(4000, rel=0.01)
    assert effective_number(0.0, each.sum(), 0.0) == 0
