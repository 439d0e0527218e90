"""Trials: compared by the errors of all that is due and the start's innovations, and alike in one batch or alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import trackbench as tb
from trackbench.api.scenario import load
from trackbench.base.execution import Executor
from trackbench.runner import work
from trackbench.scenario import Scenario
from trackbench.scenario.truth import truths_of
from trackbench.subjects.tuning.evaluation import Bench, Evaluator
from trackbench.subjects.tuning.held_out import Split, compare_held_out, halved
from trackbench.subjects.tuning.measures import Sums
from trackbench.subjects.tuning.objectives import objective_of

CV: dict[str, Any] = {"filter": "ekf", "motion": "cv", "acceleration_sigma_mps2": 2}
SCENARIO = {
    "name": "covered",
    "truth": {
        "source": "scripted",
        "duration_s": 3,
        "rate_hz": 10,
        "objects": {
            "a": {"start": {"x": 60, "y": 0, "vx_mps": 8, "vy_mps": 1}},
            "b": {"start": {"x": -20, "y": 60, "vx_mps": 12}},
        },
    },
    "sensors": {"lidar": {"type": "lidar", "rate_hz": 10, "position_sigma_m": 0.15, "detection_probability": 0.8}},
    "trackers": {
        "early": CV,
        "late": {**CV, "initial": {"skip": 5}},
    },
    "monte_carlo": {"runs": 4, "seed": 4},
    "score": {"settle_s": 0},
}


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load(SCENARIO)


def evaluator(scenario: Scenario, tracker: str) -> Evaluator:
    return Evaluator([Bench(scenario, truths_of(scenario))], tracker, Executor())


def sums_of(evaluate: Evaluator, point: dict[str, Any]) -> Sums:
    (outcome,) = evaluate([point])[0]
    assert outcome.sums is not None, outcome.failed
    return outcome.sums


def test_what_a_trial_gives_beyond_the_start_does_not_count(scenario: Scenario) -> None:
    early, late = evaluator(scenario, "early"), evaluator(scenario, "late")
    start, trial, all_of_it = (sums_of(*of) for of in ((late, {}), (late, {"initial.skip": 0}), (early, {})))
    np.testing.assert_array_equal(trial.values["log_likelihood"][1], start.values["log_likelihood"][1])
    assert (trial.values["log_likelihood"][1] < all_of_it.values["log_likelihood"][1]).all()
    assert (trial.values["log_likelihood"][0] != all_of_it.values["log_likelihood"][0]).all()
    loss = objective_of("likelihood", [scenario])(late([{"initial.skip": 0}])[0], [start])
    assert loss == pytest.approx(-trial.value("log_likelihood"), rel=1e-12)


def test_a_trial_that_lacks_an_innovation_of_the_start_is_refused(scenario: Scenario) -> None:
    evaluate = evaluator(scenario, "early")
    start, trial = evaluate.start[0].sums, sums_of(evaluate, {"initial.skip": 5})
    assert start is not None
    counts = [sums.values["log_likelihood"][1].sum() for sums in (trial, start)]
    assert trial.lacking(start, "log_likelihood") == (
        f"it gives {counts[0]:.0f} of the {counts[1]:.0f} innovations that the start gives"
    )
    likelihood, error = (objective_of(name, [scenario]) for name in ("likelihood", "position_rmse"))
    assert "innovations that the start gives" in compare_held_out(evaluate, likelihood, {"initial.skip": 5}).failed
    held_out = compare_held_out(evaluate, error, {"initial.skip": 5})
    verdicts = {one.measure: one.verdict for one in held_out.comparisons}
    assert verdicts == {"position_rmse": "undecided", "velocity_rmse": "worse"}
    held_out = compare_held_out(evaluate, likelihood, {"acceleration_sigma_mps2": 3.0})
    assert {one.measure for one in held_out.comparisons} == {"position_rmse", "velocity_rmse", "nees", "log_likelihood"}


def test_an_error_is_charged_for_missing_estimates_as_in_a_run(scenario: Scenario) -> None:
    """Of a trial that starts late: no more than what a run charges, which no start lacks."""
    trial = sums_of(evaluator(scenario, "early"), {"initial.skip": 5})
    late = tb.run(load(SCENARIO, trackers=["late"]))["late"]
    start = evaluator(scenario, "early").start[0].sums
    assert start is not None
    assert late.velocity_rmse.charged_share > 0.5
    for name in ("position_rmse", "velocity_rmse"):
        np.testing.assert_array_equal(trial.values[name][1], start.values[name][1])
        assert trial.value(name) == pytest.approx(late.metrics[name].value, rel=1e-12)
        assert trial.value(name) > start.value(name)
    assert trial.lacking(start, "position_rmse") is None
    assert "estimates that the start gives" in str(trial.lacking(start, "nees"))


def test_the_pieces_of_a_trial_do_not_change_it(scenario: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    points = [{"acceleration_sigma_mps2": sigma} for sigma in (1.0, 3.0)]

    def tried() -> list[Sums | None]:
        several = Evaluator([Bench(scenario, truths_of(scenario))], "late", Executor())
        return [outcomes[0].sums for outcomes in (*several(points), several.start)]

    whole = tried()
    # Two objects: blocks of one run, then of two.
    monkeypatch.setattr(work, "BATCH_SIZE", 2)
    for one, other in zip(tried(), whole, strict=True):
        assert one is not None
        assert other is not None
        for name, values in one.values.items():
            np.testing.assert_allclose(values, other.values[name], rtol=1e-12, err_msg=name)


@pytest.mark.parametrize(
    ("own", "number", "tested"), [([3, 7], 3, [3, 7, 4]), ([2, 9, 5], 2, [2, 9]), (2, 4, [1, 2, 3, 4])]
)
def test_the_test_has_the_scenarios_own_scenes_first(own: Any, number: int, tested: list[int]) -> None:
    truth = {"source": "highway-env", "env": "highway-v0", "duration_s": 5, "rate_hz": 10, "seeds": own}
    truth |= {"seed": 1} if own == 2 else {}
    halves = halved(load({**SCENARIO, "truth": truth}), Split(test_scenes=number))
    train, test = ([scene.seed for scene in half.config.truth.scenes()] for half in (halves.train, halves.test))
    assert test == tested
    assert not {*train} & {*test}
