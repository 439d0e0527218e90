"""Filters on truths that their own model draws: there theory says what the scores must be."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.scenes import block_of, random_walk, values, work

from trackbench.metrics import health
from trackbench.models.sensors import Lidar, Radar
from trackbench.models.sensors.effects.errors import Bias
from trackbench.trackers.config import FilterConfig

RUNS, STEPS, SIGMA = 400, 100, 2.0
LIDAR = Lidar(rate_hz=10, position_sigma_m=0.3)
RADAR = Radar(rate_hz=10, phase_s=0.05, range_sigma_m=0.3, azimuth_sigma_deg=0.5, range_rate_sigma_mps=0.2)
INITIAL = {"from": "truth", "position_sigma_m": 1.0, "velocity_sigma_mps": 2.0}
START = np.array([60.0, 20.0, 10.0, -5.0])


def config(name, sigma=SIGMA, **keys):
    return FilterConfig.model_validate(
        {"filter": name, "motion": "cv", "acceleration_sigma_mps2": sigma, "initial": INITIAL, **keys}
    )


def scores_of(sensors, trackers, dt, seed=1, **more):
    """Of trackers on truths that constant velocity draws at the instants of the sensors."""
    of = random_walk(RUNS, STEPS, dt, SIGMA, seed, START)
    block = block_of(work(of, sensors, trackers, RUNS, acceleration=SIGMA, **more), range(RUNS))
    return {name: outcome.scores for name, outcome in block.outcomes.items()}


def summaries(scores):
    return {name: values(item) for name, item in scores.items()}


def near(interval, value):
    """Whether a value lies within twice the half width of a 95 % interval: a seed in ten thousand fails by chance."""
    low, high = interval
    return abs(value - (low + high) / 2) < high - low


def test_the_kalman_filter_is_consistent_and_its_error_is_the_cramer_rao_bound():
    found = summaries(scores_of({"lidar": LIDAR}, {"kf": config("kf")}, dt=0.1))["kf"]
    assert found["nees"].verdict == "consistent"
    assert near(found["nees"].ci95, 4.0)
    assert found["nees"].steps_inside_bounds > 0.85
    nis = found["nis.lidar"]
    assert nis.verdict == "consistent"
    assert near(nis.ci95, 2.0)
    assert nis.inside95 == pytest.approx(0.95, abs=0.005)
    assert nis.steps_inside_bounds > 0.85
    assert found["whiteness.lidar"].verdict == "white"
    for what in ("position", "velocity"):
        assert near(found[f"{what}_over_reference"].ci95, 1.0)


def test_filters_of_radar_and_lidar_are_consistent_and_reach_the_bound():
    trackers = {name: config(name) for name in ("ekf", "ukf", "ckf")}
    for found in summaries(scores_of({"radar": RADAR, "lidar": LIDAR}, trackers, dt=0.05)).values():
        assert found["nees"].verdict == "consistent"
        assert near(found["nees"].ci95, 4.0)
        for sensor, dof in (("radar", 3), ("lidar", 2)):
            assert found[f"nis.{sensor}"].verdict == "consistent"
            assert near(found[f"nis.{sensor}"].ci95, dof)
            assert found[f"nis.{sensor}"].inside95 == pytest.approx(0.95, abs=0.005)
        for what in ("position", "velocity"):
            assert near(found[f"{what}_over_reference"].ci95, 1.0)


@pytest.mark.parametrize(
    ("told", "verdict", "whiteness"),
    [
        (0.5, "optimistic", "coloured"),
        # Its autocorrelation is -0.053, where 0.05 is the limit.
        (2**-0.5, "optimistic", "undecided"),
        (1.0, "consistent", "white"),
        (2**0.5, "pessimistic", "coloured"),
        (2.0, "pessimistic", "coloured"),
    ],
)
def test_a_filter_told_the_wrong_sensor_noise_is_found_out(told, verdict, whiteness):
    of = random_walk(RUNS, STEPS, 0.1, SIGMA, 2, START)
    whole = work(of, {"lidar": LIDAR}, {"kf": config("kf")}, RUNS)
    (scene,) = whole.scenes
    sensors = [replace(sensor, noise_covariance=told**2 * sensor.noise_covariance) for sensor in scene.sensors]
    found = values(
        block_of(replace(whole, scenes=[replace(scene, sensors=sensors)]), range(RUNS)).outcomes["kf"].scores
    )
    assert found["nees"].verdict == verdict
    assert found["nis.lidar"].verdict == verdict
    assert found["whiteness.lidar"].verdict == whiteness


def test_a_filter_told_the_wrong_process_noise_is_found_out():
    trackers = {"half": config("ekf", SIGMA / 2), "right": config("ekf"), "twice": config("ekf", SIGMA * 2)}
    found = summaries(scores_of({"lidar": LIDAR}, trackers, dt=0.1))
    assert [found[name]["nees"].verdict for name in trackers] == ["optimistic", "consistent", "pessimistic"]
    shares = [found[name]["nis.lidar"].inside95 for name in trackers]
    assert shares[0] < 0.945 < shares[1] < 0.955 < shares[2]
    for name in ("half", "twice"):
        assert found[name]["whiteness.lidar"].verdict == "coloured"
        assert found[name]["position_rmse"].value > found["right"]["position_rmse"].value


def test_a_bias_that_no_model_knows_is_optimistic_and_coloured():
    biased = LIDAR.model_copy(update={"effects": [Bias(sigmas={"x_m": 0.5, "y_m": 0.5})]})
    found = summaries(scores_of({"lidar": biased}, {"kf": config("kf")}, dt=0.1))["kf"]
    assert found["nees"].verdict == "optimistic"
    assert found["position_over_reference"].ci95[0] > 1.5


def test_covariances_that_a_loose_start_breaks_are_counted():
    # Sigma points with a negative central weight and a prior that says next to nothing of the course.
    loose = {"from": "truth", "covariance_diag": [1, 1, 25, 1, 1]}
    keys = {"motion": "ctrv", "yaw_acceleration_sigma_radps2": 0.5, "initial": loose}
    trackers = {
        "negative centre": config("ukf", sigma_points="classic", **keys),
        "cubature": config("ckf", **keys),
    }
    scores = scores_of({"radar": RADAR, "lidar": LIDAR}, trackers, dt=0.05)
    broken = health(scores["negative centre"])
    assert broken.repaired_covariances >= broken.repaired_runs > 0
    assert health(scores["cubature"]).repaired_runs == 0
