"""Tuning: what trials are scored by, what is searched, and what is written."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trackbench as tb
from trackbench.api.scenario import load
from trackbench.base.errors import InputError
from trackbench.base.execution import Executor
from trackbench.base.types import Estimate, Scan
from trackbench.filters import InteractingMultipleModel
from trackbench.scenario import Scenario
from trackbench.scenario.truth import truths_of
from trackbench.subjects.tuning.entry import Values
from trackbench.subjects.tuning.evaluation import Bench, Evaluator
from trackbench.subjects.tuning.parameters import Parameter, parse_range, start_values, usual_ranges
from trackbench.subjects.tuning.study import Study, usual_trials
from trackbench.subjects.tuning.trials import TuningTrial, best_trial
from trackbench.trackers.builtin import ekf
from trackbench.trackers.track_steps import log_likelihood

TEXT = """# Two cars.
name: two_cars
truth:
  source: scripted
  duration_s: 4
  rate_hz: 20
  objects:
    a: {start: {x: 60, y: 0, vx_mps: 8, vy_mps: 1}, pieces: [{turn_rate_degps: 10}]}
    b: {start: {x: -20, y: 60, vx_mps: 12}}
sensors:
  lidar: {type: lidar, rate_hz: 10, position_sigma_m: 0.15, detection_probability: 0.8}
  radar:
    {type: radar, rate_hz: 10, phase_s: 0.05, range_sigma_m: 0.3, azimuth_sigma_deg: 0.5, range_rate_sigma_mps: 0.3}
trackers:
  # The plain one.
  ekf: &ekf {filter: ekf, motion: cv, acceleration_sigma_mps2: 3}   # as in the paper
  lidar_only: {<<: *ekf, sensors: [lidar]}
  many:
    <<: *ekf
    sweep: {acceleration_sigma_mps2: [1, 2]}
  ukf:
    filter: ukf
    motion: ctrv
    acceleration_sigma_mps2: 1
    yaw_acceleration_sigma_radps2: 0.3
  raw: {use: raw}
monte_carlo: {runs: 3, seed: 4}
score: {settle_s: 0}
expect:
  - {tracker: ekf, metric: position_rmse, below: 0.4}
"""


@pytest.fixture
def scenario() -> Scenario:
    return load(TEXT)


def evaluator(scenario: Scenario, tracker: str) -> Evaluator:
    return Evaluator([Bench(scenario, truths_of(scenario))], tracker, Executor())


@pytest.mark.parametrize("tracker", ["ekf", "ukf", "lidar_only"])
def test_a_trial_is_scored_as_a_run_is(scenario: Scenario, tracker: str) -> None:
    result = tb.run(load(TEXT, trackers=[tracker]))
    (outcome,) = evaluator(scenario, tracker)([{}])[0]
    assert outcome.sums is not None
    for name in ("position_rmse", "velocity_rmse", "nees"):
        assert outcome.sums.value(name) == pytest.approx(getattr(result[tracker], name).value, rel=1e-12)
    assert outcome.sums.values["log_likelihood"][1].sum() > 0


def test_the_likelihood_is_that_of_the_innovations() -> None:
    y, s = np.array([[0.3], [-0.2]]), np.array([[[0.5], [0.1]], [[0.1], [0.4]]])
    said = log_likelihood(Estimate(np.zeros((4, 1)), np.zeros((4, 4, 1)), innovation=y, innovation_covariance=s))
    inside = y[:, 0] @ np.linalg.inv(s[..., 0]) @ y[:, 0] + np.log(np.linalg.det(2 * np.pi * s[..., 0]))
    assert said == pytest.approx(-0.5 * inside, rel=1e-12)


def test_the_density_of_a_measurement_under_an_imm_has_the_integral_one() -> None:
    models = [{"model": "cv", "acceleration_sigma_mps2": sigma} for sigma in (0.5, 20.0)]
    tracker = ekf(motion={"imm": models, "stay_s": [1.0, 1.0]}, initial="two_measurements").tracker
    assert isinstance(tracker.filter, InteractingMultipleModel)
    step = 0.25
    axis = np.arange(-12.0, 12.0, step)
    grid = np.stack(np.meshgrid(axis, axis)).reshape(2, -1)

    def scan(time: float, measurement: Any) -> Scan:
        pose, still = np.zeros(3), np.zeros(2)
        valid = np.ones(grid.shape[1], dtype=bool)
        return Scan(time, "lidar", "lidar", measurement, valid, np.diag([0.09, 0.09]), pose, still, time)

    state = None
    for time in (0.0, 1.0):
        state, _ = tracker.step(state, scan(time, np.zeros_like(grid)))
    _, estimate = tracker.step(state, scan(1.5, grid))
    density = log_likelihood(estimate)
    assert density is not None
    assert np.exp(density).sum() * step**2 == pytest.approx(1.0, abs=1e-3)


def test_values_that_do_not_go_together_fail_alone(scenario: Scenario) -> None:
    good, bad = evaluator(scenario, "ekf")([{"initial.skip": 0}, {"initial.skip": -1}])
    assert good[0].sums is not None
    assert bad[0].sums is None


@pytest.mark.parametrize(
    ("text", "scale"),
    [
        ("acceleration_sigma_mps2=0.1:30", "log"),
        ("initial.skip=0:3", "integer"),
        ("measurement_noise.radar.range_sigma_m=0.1:1", "log"),
        ("advance_at=own_scans,all_scans", "choice"),
    ],
)
def test_a_range_is_on_the_scale_of_its_option(scenario: Scenario, text: str, scale: str) -> None:
    assert parse_range(text, scenario, "ekf").scale == scale


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("acceleration_sigma_mps2", "write KEY=LOW:HIGH"),
        ("acceleration_sigma_mps2=30:0.1", "acceleration_sigma_mps2=0.1:30"),
        ("acceleration_sigma_mps2=1:1", "the same"),
        ("acceleration_sigma_mps2=-1:2", "must be at least 1e-09"),
        ("acceleration_sigma_mps2=a:2", "no number"),
        ("acceleration_sigma=1:2", "acceleration_sigma_mps2"),
        ("yaw_acceleration_sigma_radps2=1:2", "motion cv does not use this"),
        ("measurement_noise.rader.range_sigma_m=1:2", "radar"),
        ("advance_at=own_scans,al_scans", "all_scans"),
        ("initial.skip=0:5000", "1000"),
    ],
)
def test_a_range_that_cannot_be_says_what_could(scenario: Scenario, text: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        parse_range(text, scenario, "ekf")
    assert message in error.value.message
    assert error.value.key == f"--range {text}"


def test_the_usual_ranges_are_of_the_process_noise(scenario: Scenario) -> None:
    found = usual_ranges(scenario, "ukf")
    assert [item.key for item in found] == ["acceleration_sigma_mps2", "yaw_acceleration_sigma_radps2"]
    assert start_values(scenario, "ukf", found) == {"acceleration_sigma_mps2": 1, "yaw_acceleration_sigma_radps2": 0.3}
    models = "[{model: cv, acceleration_sigma_mps2: 1}, {model: ca, jerk_sigma_mps3: 5}]"
    imm = load(TEXT, [f"trackers.imm={{filter: ekf, motion: {{imm: {models}, stay_s: [5, 2]}}}}"])
    found = usual_ranges(imm, "imm")
    noises = {"motion.imm.0.acceleration_sigma_mps2": 1, "motion.imm.1.jerk_sigma_mps3": 5}
    assert start_values(imm, "imm", found) == {**noises, "motion.stay_s.0": 5, "motion.stay_s.1": 2}
    with pytest.raises(InputError, match="--range"):
        usual_ranges(scenario, "raw")


def test_a_probability_is_searched_on_the_scale_of_its_odds() -> None:
    gate = Parameter("gate", "odds", 0.9, 0.99999)
    study = Study("tracker", None, [gate])
    study.search(None, lambda points: [TuningTrial(dict(point), 0.0) for point in points], 10, seed=0)
    nines = -np.log10([1.0 - trial.values["gate"] for trial in study.trials])
    assert ((nines >= 1.0 - 1e-9) & (nines <= 5.0 + 1e-9)).all()
    # As many of the first, evenly spread trials above three nines as below.
    assert 3 <= (nines > 3.0).sum() <= 7


PARAMETERS = (Parameter("a", "log", 0.01, 10.0), Parameter("b", "log", 0.01, 10.0))


def made(points: Sequence[Values]) -> list[TuningTrial]:
    found = []
    for point in points:
        x, y = np.log(point["a"] / 0.3), np.log(point["b"] / 2.0)
        loss = float(x**2 + 3 * y**2 + x * y + 0.1 * x**3)
        found.append(TuningTrial(dict(point), loss))
    return found


def searched(storage: Path | None, stop: int | None = None, trials: int = 100) -> Study:
    """A search, interrupted before it makes a batch beyond so many trials."""
    study = Study("tracker", storage, PARAMETERS)

    def make(points: Sequence[Values]) -> list[TuningTrial]:
        if stop is not None and len(study.trials) >= stop:
            raise KeyboardInterrupt
        return made(points)

    study.search({"a": 1.0, "b": 1.0}, make, trials, seed=3)
    return study


def test_the_search_finds_a_smooth_optimum() -> None:
    assert usual_trials(PARAMETERS) == 100
    study = searched(None)
    assert study.trials[0].values == {"a": 1.0, "b": 1.0}
    best = best_trial(study.trials)
    assert best is not None
    # The best of 100 points that are spread evenly over the logarithms would be off by some 35 %.
    assert best.values["a"] == pytest.approx(0.3, rel=0.15)
    assert best.values["b"] == pytest.approx(2.0, rel=0.15)


def test_an_interrupted_search_goes_on_with_the_same_trials(tmp_path: Path) -> None:
    whole = searched(None, trials=32)
    with pytest.raises(KeyboardInterrupt):
        searched(tmp_path / "study.db", stop=20, trials=32)
    kept = Study("tracker", tmp_path / "study.db", PARAMETERS)
    assert 20 <= len(kept.trials) < 32
    # A batch of which only a part was written.
    kept.search({"a": 1.0, "b": 1.0}, made, len(kept.trials) + 1, seed=3)
    assert kept.trials == whole.trials[: len(kept.trials)]
    assert [trial.values for trial in searched(tmp_path / "study.db", trials=32).trials] == [
        one.values for one in whole.trials
    ]


def test_a_file_that_is_no_storage_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.db").write_text("shopping")
    with pytest.raises(InputError, match="no study"):
        Study("tracker", tmp_path / "notes.db", PARAMETERS)


def test_a_program_tunes_as_the_command_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: Any) -> None:
    monkeypatch.chdir(tmp_path)
    Path("two_cars.yaml").write_text(TEXT, encoding="utf-8")
    told: list[float] = []
    tuned = tb.tune(
        "two_cars.yaml",
        ["ekf"],
        ranges=["acceleration_sigma_mps2=0.5:10"],
        trials=4,
        progress=lambda done, every: told.append(done / every),
    )
    arguments = ("--trackers", "ekf", "--range", "acceleration_sigma_mps2=0.5:10", "--trials", "4", "--json")
    said = json.loads(cli("tune", "two_cars.yaml", *arguments).out)
    assert tuned.json()["trackers"] == said["trackers"]
    value = tuned.values["ekf"]["acceleration_sigma_mps2"]
    assert tuned["ekf"].best.values == {"acceleration_sigma_mps2": value}
    assert told[-1] == 1.0
    assert "tuned.yaml" in " ".join(tuned.save("out/tuned.yaml"))
    motion = load(Path("out/tuned.yaml")).config.trackers["ekf"].motion
    assert motion.acceleration_sigma_mps2 == pytest.approx(value)
    assert f"{value:.4g}" in str(tuned)
    assert "<iframe" in tuned._repr_html_()
    with pytest.raises(InputError, match="ekf"):
        tb.tune("two_cars.yaml", ["efk"])
