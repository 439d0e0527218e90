"""What intervals say of a covariance."""

from __future__ import annotations

import pytest
from benchmarks.calibration.verdicts import RIGHT_ON_AVERAGE, right_on_average

from trackbench.metrics.verdicts import (
    condition_verdict,
    condition_verdicts,
    doubtless_verdict,
    mean_verdict,
    meaning,
    overall_verdict,
    whiteness_verdict,
)
from trackbench.results import ConditionScores, ConditionVerdict, MetricValue


@pytest.mark.parametrize(
    ("ci95", "expected"),
    [
        ((3.7, 4.2), "consistent"),
        ((4.1, 4.3), "consistent"),
        ((3.6, 4.4), "consistent"),
        ((4.1, 4.5), "undecided"),
        ((4.41, 4.5), "optimistic"),
        ((7.0, 9.0), "optimistic"),
        ((3.5, 3.9), "undecided"),
        ((3.5, 3.59), "pessimistic"),
        ((3.0, 5.0), "undecided"),
        (None, "undecided"),
    ],
)
def test_verdicts_of_a_nees_of_four_degrees_of_freedom(ci95, expected):
    assert mean_verdict(ci95, 4) == expected


@pytest.mark.parametrize(
    ("ci95", "expected"),
    [
        ((3.0, 6.0), "consistent"),
        ((2.9, 3.1), "undecided"),
        ((2.8, 2.9), "pessimistic"),
        ((5.9, 6.1), "undecided"),
        ((6.1, 9.0), "optimistic"),
    ],
)
def test_verdicts_under_a_condition_allow_for_more(ci95, expected):
    assert condition_verdict(ci95, 4) == expected


@pytest.mark.parametrize(
    ("ci95", "expected"),
    [
        ((0.01, 0.02), "white"),
        ((0.01, 0.06), "undecided"),
        ((0.051, 0.06), "coloured"),
        ((-0.3, -0.2), "coloured"),
        ((-0.01, 0.06), "undecided"),
        (None, "undecided"),
    ],
)
def test_verdicts_of_a_correlation(ci95, expected):
    assert whiteness_verdict(ci95) == expected


@pytest.mark.parametrize(
    ("whole", "conditions", "expected"),
    [
        ("consistent", ["consistent", "consistent"], "consistent"),
        ("consistent", [], "consistent"),
        ("consistent", ["consistent", "undecided"], "undecided"),
        ("consistent", ["consistent", "optimistic"], "mixed"),
        ("consistent", ["optimistic", "pessimistic"], "mixed"),
        ("undecided", ["consistent", "consistent"], "undecided"),
        ("undecided", ["undecided", "optimistic"], "optimistic"),
        ("undecided", ["consistent", "optimistic"], "optimistic"),
        ("undecided", ["pessimistic", "optimistic"], "mixed"),
        # Off by little everywhere, within what is allowed under a condition.
        ("optimistic", ["consistent", "consistent"], "optimistic"),
        ("pessimistic", ["undecided", "undecided"], "pessimistic"),
        ("optimistic", ["optimistic", "undecided"], "optimistic"),
        ("optimistic", ["optimistic", "consistent"], "optimistic"),
        ("optimistic", ["pessimistic"], "mixed"),
    ],
)
def test_the_verdict_takes_every_condition_into_account(whole, conditions, expected):
    found = [ConditionVerdict(name="any", mean=4.0, ci95=(3.9, 4.1), verdict=word) for word in conditions]
    assert overall_verdict(4.0, whole, found) == expected


@pytest.mark.parametrize(("mean", "expected"), [(5.0, "optimistic"), (8.0, "mixed")])
def test_consistent_under_one_condition_and_far_from_it_over_all_is_mixed(mean, expected):
    """A covariance that is too small by the same everywhere, and one that is right where it is straight."""
    straight = ConditionVerdict(name="straight", mean=4.1, ci95=(4.0, 4.2), verdict="consistent")
    turning = ConditionVerdict(name="turning", mean=30.0, ci95=(29.0, 31.0), verdict="optimistic")
    assert overall_verdict(mean, "optimistic", [straight, turning]) == expected
    first = straight.model_copy(update={"name": "first second"})
    assert overall_verdict(mean, "optimistic", [first, turning]) == "optimistic"


def scores(count, runs=100, ci95=(3.9, 4.1)):
    nees = MetricValue(value=4.0, unit="1", dof=4, ci95=ci95, reason=None if ci95 else "one run")
    return ConditionScores(count=count, given=count, runs=runs, metrics={"nees": nees})


def test_a_condition_is_judged_where_it_has_enough_estimates_and_runs():
    found = {
        "": scores(1000),
        "manoeuvre: straight": scores(960),
        "manoeuvre: turning": scores(20),
        "manoeuvre: braking": scores(19),
        "manoeuvre: accelerating": scores(21, 4),
        "range: 0 to 20 m": scores(980),
        "range: 20 to 50 m": scores(20, ci95=None),
        "age: first second": scores(50, ci95=(2.0, 2.5)),
        "age: later": scores(950),
        "jump: after a velocity jump": scores(500, ci95=(20.0, 30.0)),
    }
    names = {condition.name: condition.verdict for condition in condition_verdicts(found)}
    assert names == {
        "straight": "consistent",
        "turning": "consistent",
        "0 to 20 m": "consistent",
        "first second": "pessimistic",
    }


@pytest.mark.parametrize(
    ("whole", "turning", "share"),
    [(1000, 100, None), (980, 98, "98 % given"), (998, 98, "turning 98 % given"), (998, 0, None)],
)
def test_an_undecided_verdict_tells_of_missing_estimates(whole, turning, share):
    """More runs would not tell; nothing is judged where none is given."""
    of_turns = scores(100) if turning else ConditionScores(count=100, given=0, runs=100)
    conditions = {
        "": scores(1000).model_copy(update={"given": whole}),
        "manoeuvre: turning": of_turns.model_copy(update={"given": turning}),
        "manoeuvre: straight": scores(900),
    }
    few = "too few runs or scenes to say whether the errors are as large as its covariance states"
    many = f"too many estimates are missing to say whether the errors are as large as stated: {share}, 99 % needed"
    undecided, optimistic = (MetricValue(unit="1", dof=4, verdict=word) for word in ("undecided", "optimistic"))
    assert meaning(undecided, conditions) == (many if share else few)
    assert meaning(optimistic, conditions) == "the errors are larger than its covariance states"


@pytest.mark.slow
@pytest.mark.parametrize(("scenario", "seed"), RIGHT_ON_AVERAGE)
def test_a_mean_that_is_right_on_simulated_traffic_is_right_by_cancellation(scenario, seed):
    for nees in right_on_average(scenario, seed, 50).values():
        assert nees.value == pytest.approx(4.0, rel=0.1)
        assert nees.verdict == "mixed"
        assert {item.name: item.verdict for item in nees.conditions}["turning"] == "optimistic"


def test_few_runs_decide_what_is_beyond_doubt_and_nothing_else() -> None:
    assert doubtless_verdict(164.0, 3, 4) == "optimistic"
    assert doubtless_verdict(164.0, 1, 4) == "optimistic"
    assert doubtless_verdict(0.05, 2, 4) == "pessimistic"
    for parts in (1, 2, 3, 5):
        assert doubtless_verdict(4.0, parts, 4) == "undecided"
    # The 99.9 % point of chi-square with 8 degrees of freedom, 26.12, over two runs, and a tenth more.
    assert doubtless_verdict(1.1 * 26.0 / 2, 2, 4) == "undecided"
    assert doubtless_verdict(1.1 * 26.3 / 2, 2, 4) == "optimistic"
