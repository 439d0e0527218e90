"""The tuning of one tracker: the search on some scenes and noise, and the test on others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.execution import Executor
from trackbench.base.types import NotedProgress, no_progress
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import EngineName
from trackbench.engine.equations import ComputedBy
from trackbench.runner.assemble import log_left_to_numpy
from trackbench.subjects.tuning.entry import Values
from trackbench.subjects.tuning.evaluation import Bench, Evaluator
from trackbench.subjects.tuning.held_out import HeldOut, compare_held_out, number_of_parts
from trackbench.subjects.tuning.measures import Sums
from trackbench.subjects.tuning.objectives import Objective
from trackbench.subjects.tuning.parameters import Parameter
from trackbench.subjects.tuning.study import Study, study_name
from trackbench.subjects.tuning.trials import TuningTrial, best_trial


@dataclass(frozen=True, kw_only=True)
class TuningTask:
    """Task of tuning one tracker: its options with ranges and start values, the objective, and the number of trials."""

    tracker: str
    objective: Objective
    parameters: tuple[Parameter, ...]
    start: dict[str, Any]
    """Values of the options in the scenario; None where a value is outside its range."""
    count: int
    """Number of trials to make."""
    seed: int = 0
    storage: Path | None = None


@dataclass(frozen=True, kw_only=True)
class Tuning(TuningTask):
    """Tuned values of one tracker, and their test on held-out scenes or noise."""

    scenarios: tuple[str, ...]
    best: TuningTrial
    trials: tuple[TuningTrial, ...]
    held_out: HeldOut
    apart: tuple[str, ...]
    """For each scenario the difference between test and tuning measurements in words; empty where there is none."""
    train_scenes: tuple[int, ...]
    train_runs: tuple[int, ...]
    engine: ComputedBy | None
    """Engine that computed a built-in tracker; None for any other tracker."""

    @property
    def edges(self) -> list[tuple[Parameter, float]]:
        """Parameters whose tuned value lies at an end of the range, with that end."""
        edges = [(item, item.edge(self.best.values[item.key])) for item in self.parameters]
        return [(item, edge) for item, edge in edges if edge is not None]


def tune_tracker(
    task: TuningTask,
    benches: Sequence[tuple[Bench, Bench, str]],
    executor: Executor,
    isolation: Isolation = ISOLATED,
    engine: EngineName = "auto",
    progress: NotedProgress = no_progress,
) -> Tuning:
    """Search the best values on some scenes and noise, and compare them with the start on other scenes and noise.

    Args:
        task: tracker, options and objective.
        benches: bench for tuning, bench for the test, and their difference in words, by scenario.
        executor: makes the trials, in this process or others.
        isolation: how a tracker that is not built in is kept apart.
        engine: ``auto``, ``numpy`` or ``fused``.
        progress: called with the number of finished trials, the number of all trials and a note.

    Raises:
        InputError: the tracker fails with its start values, the objective has no value, or the storage is unusable.
    """
    objective, total = task.objective, task.count
    measured = objective.metric, objective.measure
    train, test, apart = zip(*benches, strict=True)
    evaluator = Evaluator(train, task.tracker, executor, isolation, engine, total, *measured)
    start = _start_sums(evaluator, objective)
    used = evaluator.engine_used
    if used is not None:
        log_left_to_numpy("tuning", task.tracker, used)
    name = study_name(task.tracker, objective.name, task.parameters, task.seed, train, start)
    study = Study(name, task.storage, task.parameters)

    def make(points: Sequence[Values]) -> list[TuningTrial]:
        made = len(study.trials)
        outcomes = evaluator(points, lambda part, parts: progress(made + part / parts * len(points), total))
        losses = [objective(outcome, start) for outcome in outcomes]
        return [TuningTrial.of(*pair) for pair in zip(points, losses, strict=True)]

    is_tried = all(item.holds(task.start[item.key]) for item in task.parameters)
    study.search(task.start if is_tried else None, make, total, task.seed)
    made = study.trials[:total]
    best = best_trial(made)
    if best is None:
        raise InputError(f"{task.tracker}: every trial failed; the first: {made[0].failed}", key="--range")

    progress(total, total, "now on the held-out data")
    held_out = Evaluator(test, task.tracker, executor, isolation, evaluator.engine, 1, *measured)
    return Tuning(
        **vars(task),
        scenarios=tuple(bench.name for bench in train),
        best=best,
        trials=tuple(made),
        held_out=compare_held_out(held_out, objective, best.values),
        apart=apart,
        train_scenes=tuple(number_of_parts(bench.scenario.config) for bench in train),
        train_runs=tuple(bench.scenario.config.monte_carlo.runs for bench in train),
        engine=None if used is None else used.engine,
    )


def _start_sums(evaluator: Evaluator, objective: Objective) -> list[Sums]:
    """Return the sums of the tracker with its start values, by scenario.

    Raises:
        InputError: the tracker fails, or does not give what the objective needs.
    """
    sums = []
    for bench, outcome in zip(evaluator.benches, evaluator.start, strict=True):
        where = f"{evaluator.tracker} in {bench.name}"
        if outcome.sums is None:
            raise InputError(f"{where} fails as it is: {outcome.failed}", file=bench.scenario.path)
        if not np.isfinite(outcome.sums.value(objective.measure)):
            if objective.name != "likelihood":
                problem = f"{where} has no {objective.measure}: nothing is scored"
            elif bench.hidden:
                problem = f"{where} does not predict its detections, so that there is no likelihood"
            else:
                problem = f"{where} gives no innovations, so that there is no likelihood; choose position_rmse"
            raise InputError(problem, key="--objective")
        sums.append(outcome.sums)
    return sums
