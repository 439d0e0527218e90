"""Built-in trackers taken through many scans by one sequence of calls: what steps and scores by themselves give."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

import trackbench as tb
from trackbench.engine.machine import unavailable
from trackbench.metrics.built_in.step_time import StepTime
from trackbench.runner import sequence_run
from trackbench.runner.recorded import Outcome
from trackbench.runner.tracker_run import TrackerRun

pytestmark = pytest.mark.skipif(unavailable() is not None, reason=f"no machine code here: {unavailable()}")

#: Effects of what is left to steps: a track that starts late, and one whose course is lost.
SCENARIOS = ("sensor_dropout", "intersection")
#: No multiple of the members of a vector.
RUNS = 26


def outcomes(monkeypatch: pytest.MonkeyPatch, scenario: tb.Scenario, by_steps: bool) -> dict[str, Outcome]:
    """What each tracker leaves of the first block."""
    left: dict[str, Outcome] = {}
    close = TrackerRun.close

    def kept(self: TrackerRun) -> Any:
        outcomes = close(self)
        assert isinstance(outcomes, list)
        left.setdefault(self.name, outcomes[0])
        return outcomes

    with monkeypatch.context() as patch:
        patch.setattr(TrackerRun, "close", kept)
        if by_steps:
            patch.setattr(TrackerRun, "_take_sequence", lambda self, instant: 0)
        tb.run(scenario, engine="fused")
    return left


def same(value: Any, expected: Any, what: str) -> None:
    """To 1e-11 of the largest of a row: sums of other orders, of estimates that agree to 1e-12."""
    if hasattr(expected, "__dict__"):
        for name in vars(expected):
            same(getattr(value, name), getattr(expected, name), f"{what}.{name}")
    elif isinstance(expected, dict):
        assert value.keys() == expected.keys(), what
        for key in expected.keys() - {StepTime.name}:
            same(value[key], expected[key], f"{what} {key}")
    elif isinstance(expected, list | tuple):
        for number, (own, other) in enumerate(zip(value, expected, strict=True)):
            same(own, other, f"{what} {number}")
    elif isinstance(expected, np.ndarray):
        largest = np.nanmax(np.abs(np.atleast_2d(expected)), axis=-1, initial=1e-9, keepdims=True)
        # What a block has no number for is infinite.
        with np.errstate(invalid="ignore"):
            own, other = np.atleast_2d(value) / largest, np.atleast_2d(expected) / largest
        np.testing.assert_allclose(own, other, 0, 1e-11, err_msg=what)
    else:
        assert value == expected, what


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_sequence_gives_the_scores_of_its_steps(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    instants = [0]
    through = sequence_run.run_sequence

    def counted(*arguments: Any) -> Any:
        taken = through(*arguments)
        instants[0] += 0 if taken is None else taken[0].steps[-1].instant + 1
        return taken

    monkeypatch.setattr(sequence_run, "run_sequence", counted)
    scenario = tb.load(name, {"truth.duration_s": 8}, runs=RUNS)
    by_sequences = outcomes(monkeypatch, scenario, by_steps=False)
    every = sum(outcome.scores.per_step.shape[1] for outcome in by_sequences.values())
    assert instants[0] > 0.6 * every
    by_steps = outcomes(monkeypatch, scenario, by_steps=True)
    assert by_sequences.keys() == by_steps.keys()
    for tracker, outcome in by_sequences.items():
        same(outcome, by_steps[tracker], f"{name} {tracker}")


COMING: dict[str, Any] = {
    "name": "coming",
    "truth": {
        "source": "scripted", "duration_s": 8, "rate_hz": 10,
        "objects": {"car": {"start": {"x": 60, "speed_mps": 6, "course_deg": 180}}},
    },
    "sensors": {
        "lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.2},
        "radar": {
            "type": "radar", "rate_hz": 10, "max_range_m": 40,
            "range_sigma_m": 0.3, "azimuth_sigma_deg": 0.5, "range_rate_sigma_mps": 0.1,
        },
    },
    "trackers": {"kf": {"filter": "kf", "motion": "cv", "acceleration_sigma_mps2": 2}},
    "monte_carlo": {"runs": RUNS, "seed": 1},
}  # fmt: skip


def test_a_kalman_filter_whose_car_comes_into_the_radar_s_view_late(monkeypatch: pytest.MonkeyPatch) -> None:
    by_sequences = outcomes(monkeypatch, tb.load(COMING), by_steps=False)
    by_steps = outcomes(monkeypatch, tb.load(COMING), by_steps=True)
    same(by_sequences["kf"], by_steps["kf"], "coming")
    assert tb.run(tb.load(COMING), engine="fused")["kf"].metrics["nis.radar"].dof == 2


NOISE = {"acceleration_sigma_mps2": 3}
JERK = {"jerk_sigma_mps3": 3}
MODES = {"imm": [{"model": "cv", **NOISE}, {"model": "ca", **JERK}], "stay_s": [5, 1]}
LIDAR, RADAR = ["roof_lidar"], ["front_radar"]
#: Trackers that read one sensor, advance at all scans, start from one sensor, from the truth, or from two scans.
ODD = {
    "part": {"filter": "ekf", "motion": "cv", **NOISE, "sensors": LIDAR},
    "part_ca": {"filter": "ekf", "motion": "ca", **JERK, "sensors": RADAR},
    "all": {"filter": "ekf", "motion": "cv", **NOISE, "sensors": LIDAR, "advance_at": "all_scans"},
    "from_lidar": {"filter": "ukf", "motion": "ca", **JERK, "initial": {"sensors": LIDAR}},
    "true": {"filter": "ekf", "motion": "ctrv", **NOISE, "yaw_acceleration_sigma_radps2": 0.3, "initial": "truth"},
    "two": {"filter": "kf", "motion": "cv", **NOISE, "initial": "two_measurements"},
    "imm": {"filter": "ukf", "motion": MODES, "sensors": RADAR},
}


#: Sensors that fire together, and in turn: then some instants end with a measurement, others with a prediction.
TOGETHER: dict[str, Any] = {}
IN_TURN = {"sensors.front_radar.rate_hz": 10, "sensors.roof_lidar.phase_s": 0.05}


@pytest.mark.parametrize("sensors", [TOGETHER, IN_TURN], ids=["together", "in turn"])
def test_odd_trackers_too(monkeypatch: pytest.MonkeyPatch, sensors: dict[str, Any]) -> None:
    odd = {f"trackers.{name}": entry for name, entry in ODD.items()}
    scenario = tb.load("highway", {"truth.duration_s": 6, **sensors, **odd}, runs=RUNS, trackers=[*ODD])
    by_sequences, by_steps = (outcomes(monkeypatch, scenario, steps) for steps in (False, True))
    assert by_sequences.keys() == ODD.keys()
    for tracker, outcome in by_sequences.items():
        same(outcome, by_steps[tracker], tracker)


def test_other_runs_change_no_bit_of_an_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other runs decide where a sequence ends, and where steps are taken one by one."""
    few, many = (
        outcomes(monkeypatch, tb.load("u_turn", {"truth.duration_s": 8}, runs=runs), by_steps=False)
        for runs in (16, RUNS)
    )
    for tracker, outcome in few.items():
        recorded, others = outcome.recorded, many[tracker].recorded
        assert recorded is not None
        assert others is not None
        np.testing.assert_array_equal(recorded.mean, others.mean, err_msg=tracker)
        np.testing.assert_array_equal(recorded.covariance, others.covariance, err_msg=tracker)


def test_the_scores_of_the_same_scans_are_the_same_bits_whatever_the_processor_can() -> None:
    """Of tracks that start from a lidar, without a function of NumPy that has other bits on other processors."""
    code = """
import trackbench as tb

trackers = ["kf_cv", "ekf_cv", "ekf_ca", "imm_cv_ca"]
start = {f"trackers.{name}.initial": {"sensors": ["roof_lidar"]} for name in trackers}
scenario = tb.load("highway", {"truth.duration_s": 5, **start}, runs=60, trackers=trackers)
for tracker in tb.run(scenario, engine="fused").summary.trackers:
    print(tracker.name, {path: repr(item.value) for path, item in tracker.metrics.items() if path != "step_time"})
"""
    weaker = {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR", "OPENBLAS_CORETYPE": "Haswell"}
    command = [sys.executable, "-c", code]
    strong, weak = (
        subprocess.run(command, env={**os.environ, **more}, capture_output=True, text=True, check=True).stdout
        for more in ({}, weaker)
    )
    assert strong
    assert strong == weak
