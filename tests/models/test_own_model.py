"""Targets that move as the trackers assume: consistency and the Cramer-Rao bound have known answers."""

import pytest
from scipy import stats
from tests.support.places import SCENARIOS

from trackbench.results import MetricValue, Result, TrackerResult
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of

SCRIPTED = SCENARIOS / "scripted"


def result(name: str, *overrides: str) -> Result:
    loaded = load_scenario(SCRIPTED / f"{name}.yaml", overrides)
    return run_scenario(loaded, truths_of(loaded))


def nis_by_path(of: TrackerResult) -> dict[str, MetricValue]:
    return {path: value for path, value in of.metrics.items() if path.startswith("nis.")}


def by_name(of: Result) -> dict[str, TrackerResult]:
    return {tracker.name: tracker for tracker in of.summary.trackers}


@pytest.mark.parametrize("name", ["own_model", "own_model_ctrv"])
def test_consistent_at_one_instant_over_several_seeds(name: str) -> None:
    """At one instant the runs and objects are independent, so that their sum is chi-square of known freedom."""
    total: dict[str, float] = {}
    count: dict[str, float] = {}
    for seed in (1, 2, 3):
        steps = result(name, "truth.duration_s=4", "monte_carlo.runs=60", f"monte_carlo.seed={seed}").tables["steps"]
        for row in steps.to_pylist():
            if abs(row["time_s"] - 4.0) < 1e-9:
                total[row["tracker"]] = total.get(row["tracker"], 0.0) + row["nees_mean"] * row["count"]
                count[row["tracker"]] = count.get(row["tracker"], 0.0) + row["count"]
    assert set(count.values()) == {3 * 60 * 2}
    for tracker, square in total.items():
        low, high = stats.chi2.ppf([0.005, 0.995], 4 * count[tracker])
        assert low < square < high, tracker


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_verdicts_are_consistent_and_the_kalman_filter_reaches_the_bound(seed: int) -> None:
    found = by_name(result("own_model", "monte_carlo.runs=200", f"monte_carlo.seed={seed}"))
    for name, tracker in found.items():
        assert tracker.nees.verdict == "consistent", name
        for sensor, nis in nis_by_path(tracker).items():
            assert nis.mean is None or nis.verdict == "consistent", (name, sensor)
    for metric in ("position_over_reference", "velocity_over_reference"):
        over = found["kf_lidar"].metrics[metric]
        low, high = over.ci95
        # Three standard errors to each side, where the interval has two.
        assert abs(over.value - 1.0) < 1.5 * (high - low) / 2
        assert high - low < 0.07


@pytest.mark.parametrize("seed", [1, 2])
def test_verdicts_are_consistent_under_each_condition_where_the_targets_turn(seed: int) -> None:
    found = by_name(result("own_model_ctrv", "monte_carlo.runs=100", f"monte_carlo.seed={seed}"))
    for name, tracker in found.items():
        conditions = {condition.name: condition.verdict for condition in tracker.nees.conditions or ()}
        assert {"straight", "turning", "50 to 100 m", "first second"} <= set(conditions), name
        assert {*conditions.values(), tracker.nees.verdict} == {"consistent"}, name


@pytest.mark.parametrize(("sigma", "verdict"), [(1.0, "optimistic"), (4.0, "pessimistic")])
def test_the_wrong_noise_is_told_from_the_right_one(sigma: float, verdict: str) -> None:
    settings = [f"trackers.{name}.acceleration_sigma_mps2={sigma}" for name in ("kf_lidar", "ekf", "ukf")]
    found = by_name(result("own_model", "monte_carlo.runs=100", *settings))
    assert {tracker.nees.verdict for tracker in found.values()} == {verdict}
    assert all(tracker.position_over_reference.ci95[0] > 1.0 for tracker in found.values())


def test_few_runs_are_not_taken_for_consistency() -> None:
    """One run, and ten short ones, of a filter whose noise is right: nothing is shown either way."""
    ekf = by_name(result("own_model", "monte_carlo.runs=1"))["ekf"]
    assert ekf.nees.verdict == "undecided"
    # Of 400 innovations in one run, the NIS may be shown to be right already.
    assert {nis.verdict for nis in nis_by_path(ekf).values()} <= {"undecided", "consistent"}
    short = by_name(result("own_model", "monte_carlo.runs=10", "truth.duration_s=2"))["ekf"]
    assert short.nees.verdict == "undecided"


def test_a_doubled_process_noise_variance_is_told_from_the_right_one() -> None:
    """That of the process: a factor of 1.4 in its standard deviation."""
    twice = [f"trackers.{name}.acceleration_sigma_mps2={2 * 2**0.5}" for name in ("kf_lidar", "ekf", "ukf")]
    found = by_name(result("own_model", "monte_carlo.runs=100", *twice))
    assert {tracker.nees.verdict for tracker in found.values()} == {"pessimistic"}
