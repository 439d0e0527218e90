"""Targets that move as the trackers assume: consistency and the Cramer-Rao bound have known answers."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from tests.scenes import fixed_observer, truth
from trackbench.metrics.bound import BoundStart, cramer_rao

from trackbench.models.sensors import SENSOR_MODELS, Lidar, Radar
from trackbench.results import Result, TrackerResult
from trackbench.runner.run import run
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of
from trackbench.sensing.scans import IdealSensor, ideal_sensors
from trackbench.truth import Draw
from trackbench.types import Array, Truth

SCENARIOS = Path(__file__).parent.parent / "scenarios" / "scripted"
RADAR = Radar(rate_hz=10, range_sigma_m=0.3, azimuth_sigma_deg=0.5, range_rate_sigma_mps=0.3)


def result(name: str, *overrides: str) -> Result:
    loaded = load_scenario(SCENARIOS / f"{name}.yaml", overrides)
    return run(loaded, truths_of(loaded))


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
        for sensor, nis in tracker.of_sensors("nis").items():
            assert nis.mean is None or nis.verdict == "consistent", (name, sensor)
    for metric in ("position_efficiency", "velocity_efficiency"):
        efficiency = found["kf_lidar"].metrics[metric]
        low, high = efficiency.ci95
        # Three standard errors to each side, where the interval has two.
        assert abs(efficiency.value - 1.0) < 1.5 * (high - low) / 2
        assert high - low < 0.07


@pytest.mark.parametrize(("sigma", "verdict"), [(1.0, "optimistic"), (4.0, "pessimistic")])
def test_the_wrong_noise_is_told_from_the_right_one(sigma: float, verdict: str) -> None:
    settings = [f"trackers.{name}.acceleration_sigma_mps2={sigma}" for name in ("kf_lidar", "ekf", "ukf")]
    found = by_name(result("own_model", "monte_carlo.runs=100", *settings))
    assert {tracker.nees.verdict for tracker in found.values()} == {verdict}
    assert all(tracker.position_efficiency.ci95[0] > 1.0 for tracker in found.values())


def test_few_runs_are_not_taken_for_consistency() -> None:
    """One run, and ten short ones, of a filter whose noise is right: nothing is shown either way."""
    ekf = by_name(result("own_model", "monte_carlo.runs=1"))["ekf"]
    assert (ekf.nees.ci95, ekf.nees.reason) == (None, "one run gives no interval")
    verdicts = {ekf.nees.verdict, *(nis.verdict for nis in ekf.of_sensors("nis").values())}
    assert verdicts == {"undecided"}
    short = by_name(result("own_model", "monte_carlo.runs=10", "truth.duration_s=2"))["ekf"]
    assert short.nees.verdict == "undecided"


def test_a_doubled_process_noise_variance_is_told_from_the_right_one() -> None:
    """That of the process: a factor of 1.4 in its standard deviation."""
    twice = [f"trackers.{name}.acceleration_sigma_mps2={2 * 2**0.5}" for name in ("kf_lidar", "ekf", "ukf")]
    found = by_name(result("own_model", "monte_carlo.runs=100", *twice))
    assert {tracker.nees.verdict for tracker in found.values()} == {"pessimistic"}


def test_the_recorded_run_is_shown_as_it_moved() -> None:
    """Run 3 of the tables is run 3 of the truth, and its estimates are near it."""
    settings = ("monte_carlo.runs=5", "recording.run=3")
    loaded = load_scenario(SCENARIOS / "own_model.yaml", settings)
    moved = loaded.config.truth.load(Draw(7, "own_model", 5), folder=SCENARIOS)
    tables = run(loaded, moved).tables
    rows = [row for row in tables["truth"].to_pylist() if row["object"] == "ahead"]
    np.testing.assert_array_equal([row["px_m"] for row in rows], moved.truth.px[:, 0, 3])
    late = [row["position_error_m"] for row in tables["estimates"].to_pylist() if row["time_s"] > 5]
    assert max(late) < 1


def two_runs(second: tuple[float, float]) -> Truth:
    """A target at (40, 0) in one run and at ``second`` in the other, at rest."""
    place = np.broadcast_to(np.array([[40.0, second[0]], [0.0, second[1]]])[:, None, None], (2, 2, 1, 2))
    return truth(np.arange(2) / 10, *place, 0.0, 0.0, observer=fixed_observer(2))


def information(sensor: IdealSensor, place: tuple[float, float]) -> Array:
    h = SENSOR_MODELS[sensor.config.type].jacobian(np.array([*place, 0, 0]), sensor.pose[:, 0], sensor.velocity[:, 0])
    return np.asarray(h.T @ np.linalg.inv(sensor.noise_covariance) @ h)


def bound(of: Truth, sensor: IdealSensor, rate: float) -> Array:
    prior = BoundStart(velocity_sigma=5, position_sigma=1)
    rates = {"sensor": np.full((len(sensor.steps), 1), rate)}
    return cramer_rao(of, [sensor], rates, 2.0, prior, np.array([0]))[0, 0]


def test_the_bound_averages_the_information_over_the_runs() -> None:
    of = two_runs((0.0, 20.0))
    (radar,) = ideal_sensors(of, {"sensor": RADAR})
    mean = (information(radar, (40.0, 0.0)) + information(radar, (0.0, 20.0))) / 2
    expected = np.linalg.inv(np.diag([1, 1, 1 / 25, 1 / 25]) + mean)
    np.testing.assert_allclose(bound(of, radar, 1.0), np.diag(expected))


def test_a_run_out_of_range_gives_no_information() -> None:
    of = two_runs((0.0, 200.0))
    (radar,) = ideal_sensors(of, {"sensor": RADAR.model_copy(update={"max_range_m": 100.0})})
    expected = np.linalg.inv(np.diag([1, 1, 1 / 25, 1 / 25]) + information(radar, (40.0, 0.0)) / 2)
    np.testing.assert_allclose(bound(of, radar, 0.5), np.diag(expected))


def test_the_bound_of_a_lidar_does_not_depend_on_the_motion() -> None:
    found = []
    for of in (two_runs((0.0, 200.0)), two_runs((40.0, 0.0))):
        (lidar,) = ideal_sensors(of, {"sensor": Lidar(rate_hz=10, position_sigma_m=0.15)})
        found.append(bound(of, lidar, 1.0))
    np.testing.assert_allclose(found[0], found[1])
