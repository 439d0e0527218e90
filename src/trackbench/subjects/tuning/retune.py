"""Tunes the process noise of the trackers of a scenario, so that it can be judged by what its sensors allow."""

from __future__ import annotations

import json
from collections.abc import Sequence

from trackbench.base.errors import InputError
from trackbench.base.execution import Executor
from trackbench.scenario import Scenario
from trackbench.scenario.load import scenario_of, select_trackers
from trackbench.scenario.truth import PendingTruths
from trackbench.subjects.tuning.entry import Values
from trackbench.subjects.tuning.evaluation import Bench, Evaluator
from trackbench.subjects.tuning.held_out import Split, halved
from trackbench.subjects.tuning.objectives import OBJECTIVES, Objective, metric_objectives
from trackbench.subjects.tuning.parameters import Parameter, noise_ranges, start_values
from trackbench.subjects.tuning.search import Proposals, search
from trackbench.subjects.tuning.study import Study, TuningTrial, best_trial, require_optuna, trial_of
from trackbench.trackers.config import FilterConfig

#: The areas around the best values that the second and the third batch of trials look at, as shares of each range.
AROUND = (0.1, 0.04)
#: Of each scene that is tuned on.
RUNS = 10


def retuned(loaded: Scenario, executor: Executor) -> Scenario:
    """The scenario with tuned process noise of each built-in tracker: for the metric of the first expectation of it.

    It is tuned on other noise than the scenario's, and on other scenes where the truth has others; the same every time.

    Args:
        loaded: the scenario.
        executor: what makes the trials.

    Raises:
        InputError: a tracker is a point of a sweep, or Optuna is not installed.
    """
    require_optuna()
    train = halved(loaded, Split(train_runs=min(RUNS, loaded.config.monte_carlo.runs))).train
    bench = Bench(train, PendingTruths(train, executor).collect())
    changes = []
    for name, entry in loaded.config.trackers.items():
        if not isinstance(entry, FilterConfig):
            continue
        if any(name in points for points in loaded.sweeps.values()):
            message = "is a point of a sweep, which cannot be tuned by itself; write it as a tracker of its own"
            raise loaded.locate(InputError(message, key=f"trackers.{name}"))
        parameters = noise_ranges(loaded, name, entry)
        values = _tuned(bench, name, parameters, _objective(loaded, name), executor) if parameters else {}
        changes += [f"trackers.{name}.{key}={json.dumps(value)}" for key, value in values.items()]
    scenario = scenario_of(loaded.text, loaded.path, [*loaded.overrides, *changes])
    return select_trackers(scenario, loaded.selected) if loaded.selected else scenario


def _objective(loaded: Scenario, tracker: str) -> Objective:
    by_name = {**metric_objectives(loaded), **OBJECTIVES}
    usual = "tgospa" if loaded.config.sensing.identities == "hidden" else "position_rmse"
    required = (item.metric for item in loaded.config.expect if item.tracker == tracker)
    return by_name[next((metric for metric in required if metric in by_name), usual)]


def _tuned(
    bench: Bench, tracker: str, parameters: Sequence[Parameter], objective: Objective, executor: Executor
) -> Values:
    """The best values; none where the tracker fails as it is, or cannot be scored."""
    batches = _batches(len(parameters))
    count = sum(batch.size for batch in batches)
    evaluator = Evaluator(
        [bench],
        tracker,
        parameters,
        executor,
        engine="auto",
        trials=count,
        metric=objective.metric,
        measure=objective.measure,
    )
    start = [outcome.sums for outcome in evaluator.start if outcome.sums is not None]
    if not start:
        return {}

    def make(points: Sequence[Values]) -> list[TuningTrial]:
        return [trial_of(objective, *pair, start) for pair in zip(points, evaluator(points), strict=True)]

    study = Study(tracker, None, parameters, objective.axes, {})
    first = start_values(bench.scenario, tracker, parameters)
    search(parameters, study, first, make, objective.losses, count, seed=0, batches=batches)
    best = best_trial(study.trials)
    return {} if best is None else best.values


def _batches(parameters: int) -> list[Proposals]:
    """Few trials: spread over the ranges, and around the smallest value of a quadratic model of them."""
    around = [Proposals("local", 2 + 3 * parameters, radius) for radius in AROUND]
    return [Proposals("spread", 3 + 5 * parameters), *around]
