"""A tracker with several motion models, as a scenario has it."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.filters.test_filters_properties import TRUTH_START, measurements, through
from tests.support.scenes import NOISE, tracker

from trackbench.base.errors import TrackbenchError
from trackbench.models.motion import Kinematics
from trackbench.results import Result
from trackbench.runner.run import run_scenario
from trackbench.scenario import load_scenario
from trackbench.scenario.truth import truths_of

CV, CTRV = {"model": "cv", **NOISE["cv"]}, {"model": "ctrv", **NOISE["ctrv"]}
CA = {"model": "ca", **NOISE["ca"]}
FILTERS = ["ekf", "ukf", "ckf"]
STARTS = ["first_measurement", "two_measurements", "truth"]


def primed(made, size):
    motion = Kinematics(*(np.linspace(a, a + 1, size) for a in (30.0, 10.0, 12.0, 3.0, 0.5, 0.2)))
    times, normal = np.array([0.0, 0.2, 0.5, np.inf])[:size], np.random.default_rng(0).normal(size=(6, size))
    whole = made.with_prior(times, motion, normal)
    return whole, [
        made.with_prior(times[i], Kinematics(*(value[i] for value in motion)), normal[:, i]) for i in range(size)
    ]


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("filter", FILTERS)
@pytest.mark.parametrize("motion", [CV, CA, CTRV], ids=["cv", "ca", "ctrv"])
def test_two_equal_models_are_one(motion, filter, start):
    initial = TRUTH_START if start == "truth" else start
    one = tracker(filter=filter, motion=motion, initial=initial)
    two = tracker(filter=filter, motion={"imm": [motion, motion], "stay_s": [3, 2]}, initial=initial)
    if start == "truth":
        one, two = primed(one, 3)[0], primed(two, 3)[0]
    seen = list(measurements(3, 14, seed=4))
    for a, b in zip(through(two, seen), through(one, seen), strict=True):
        for name in ("mean", "covariance", "innovation", "innovation_covariance"):
            found, expected = getattr(a, name), getattr(b, name)
            assert (found is None) == (expected is None)
            if found is not None:
                there = ~np.isnan(expected)
                scale = np.abs(expected[there]).max(initial=1.0)
                # A mixture of equal parts rounds, which a yaw that is hardly known yet raises by some 1e5.
                np.testing.assert_allclose(found[there], expected[there], rtol=1e-10, atol=1e-11 * scale, err_msg=name)


#: The example of the page on filters.
SCENARIO = """\
name: bend
description: A vehicle that drives straight, turns, and drives straight
truth:
  source: scripted
  duration_s: 16
  rate_hz: 20
  objects:
    car:
      start: {x: 20, y: -20, speed_mps: 12, course_deg: 90}
      pieces:
        - {for_s: 6}
        - {for_s: 4, turn_rate_degps: 30}
        - {for_s: 6}
sensors:
  lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.3}
trackers:
  straight: {filter: ekf, motion: cv, acceleration_sigma_mps2: 0.3}
  turning: {filter: ekf, motion: ctrv, acceleration_sigma_mps2: 0.3, yaw_acceleration_sigma_radps2: 1}
  imm:
    filter: ekf
    motion:
      imm:
        - {model: cv, acceleration_sigma_mps2: 0.3}
        - {model: ctrv, acceleration_sigma_mps2: 0.3, yaw_acceleration_sigma_radps2: 1}
      stay_s: [5, 5]
monte_carlo: {runs: 50, seed: 1}
"""


def loaded(tmp_path: Path, change=lambda tracker: None):
    raw = yaml.safe_load(SCENARIO)
    change(raw["trackers"]["imm"])
    path = tmp_path / "scenario.yaml"
    path.write_text(yaml.safe_dump(raw, sort_keys=False))
    return load_scenario(path)


def test_a_scenario_runs_it_and_it_is_better_than_either_model(tmp_path):
    scenario = loaded(tmp_path)
    result: Result = run_scenario(scenario, truths_of(scenario))
    error = {one.name: one.metrics["position_rmse"].value for one in result.summary.trackers}
    assert error["imm"] < 0.95 * min(error["straight"], error["turning"]), error


def test_its_first_probabilities_are_those_that_the_chain_comes_to():
    keys = {"filter": "ekf", "motion": {"imm": [CV, CTRV], "stay_s": [6, 2]}}
    assert tracker(**keys).filter.initial_probabilities == (0.75, 0.25)


@pytest.mark.parametrize(
    ("change", "at", "message"),
    [
        ({"imm": [CV], "stay_s": [1]}, "motion.imm", "at least 2 entries are needed, not 1"),
        (
            {"imm": [CV, {"model": "ca", "acceleration_sigma_mps2": 0.3}], "stay_s": [1, 2]},
            "motion.imm.1.acceleration_sigma_mps2",
            "unknown key; choose from: jerk_sigma_mps3",
        ),
        ({"imm": [CV, {**CTRV, "model": "ctrw"}], "stay_s": [1, 2]}, "motion.imm.1.model", "did you mean 'ctrv'?"),
        ({"imm": [CV, "cv"], "stay_s": [1, 2]}, "motion.imm.1.acceleration_sigma_mps2", "missing"),
        ({"imm": [CV, CTRV], "stay_s": [1, 2, 3]}, "motion.stay_s", "one number for each of the 2 models is needed"),
        ({"imm": [CV, CTRV]}, "motion.stay_s", "missing; for each model the mean time"),
    ],
)
def test_mistakes_are_told_at_their_place(tmp_path, change, at, message):
    with pytest.raises(TrackbenchError) as raised:
        loaded(tmp_path, lambda one: one.update(motion=change))
    assert f"trackers.imm.{at}: " in str(raised.value)
    assert message in str(raised.value)


@pytest.mark.parametrize(
    ("keys", "at", "message"),
    [
        ({"filter": "kf"}, "motion", "kf needs a linear motion model"),
        ({"process_noise_diag": [1.0] * 4}, "process_noise_diag", "not used with imm"),
        ({"initial": {"covariance_diag": [1.0] * 4}}, "covariance_diag", "motion ctrv needs 5 variances"),
    ],
)
def test_what_does_not_go_with_several_models_is_refused(tmp_path, keys, at, message):
    with pytest.raises(TrackbenchError) as raised:
        loaded(tmp_path, lambda one: one.update(keys))
    assert f"{at}: {message}" in str(raised.value)
