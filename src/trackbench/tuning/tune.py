"""Tunes one tracker: the search on some scenes and noise, and the proof on others."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.errors import InputError
from trackbench.scenario import Scenario
from trackbench.stepping.isolation import ISOLATED, Isolation
from trackbench.tuning.entry import plain
from trackbench.tuning.evaluation import Bench, Evaluator
from trackbench.tuning.held_out import HeldOut, compare_held_out
from trackbench.tuning.measures import Sums
from trackbench.tuning.objectives import Objective
from trackbench.tuning.parameters import Parameter, Values, at_edges
from trackbench.tuning.polish import polished
from trackbench.tuning.response import FACTORS, Response
from trackbench.tuning.search import search
from trackbench.tuning.study import Study
from trackbench.tuning.trials import TuningTrial, front_of, trial_of
from trackbench.types import Progress, no_progress


@dataclass(frozen=True)
class Tuning:
    """What the tuning of one tracker found."""

    tracker: str
    scenarios: tuple[str, ...]
    objective: Objective
    parameters: tuple[Parameter, ...]
    start: dict[str, Any] | None
    """The values that it had; None where one of them is in no range."""
    best: TuningTrial
    trials: tuple[TuningTrial, ...]
    responses: tuple[Response, ...]
    """Along each parameter; the one that matters most comes first."""
    held_out: HeldOut
    apart: tuple[str, ...]
    """Of each scenario what tells the scenes and noise tried on from those tuned on; empty where nothing does."""
    train_scenes: tuple[int, ...]
    train_runs: tuple[int, ...]

    @property
    def edges(self) -> list[tuple[Parameter, float]]:
        """The parameters whose best value is at an end of its range that could be wider."""
        return at_edges(self.parameters, self.best.values)

    @property
    def front(self) -> list[TuningTrial]:
        """The trials that no other beats in both losses; empty where there is one."""
        return front_of([*self.trials, self.best]) if len(self.objective.axes) > 1 else []


@dataclass(frozen=True)
class TuningTask:
    """The tuning of one tracker."""

    tracker: str
    objective: Objective
    parameters: tuple[Parameter, ...]
    start: dict[str, Any] | None
    trials: int
    seed: int = 0
    storage: Path | None = None


def tune(
    task: TuningTask,
    train: Sequence[Bench],
    test: Sequence[Bench],
    apart: Sequence[str],
    executor: Executor,
    isolation: Isolation = ISOLATED,
    progress: Progress = no_progress,
) -> Tuning:
    """Search the best values on some scenes and noise, and hold them against the start's on others.

    Args:
        task: what is tuned, and for what.
        train: the scenarios to tune on.
        test: the same with other scenes and noise.
        apart: of each what tells the two apart.
        executor: what makes the trials.
        isolation: how a tracker that is not built in is kept apart.
        progress: called with the number of trials made and of all.

    Raises:
        InputError: the tracker fails as it is, does not give what the objective needs, or the storage does not fit.
    """
    objective = task.objective
    evaluator = Evaluator(train, task.tracker, task.parameters, executor, isolation)
    start = _start(evaluator, objective)
    study = Study(task.tracker, task.storage, task.parameters, objective.axes, _signature(task, train))

    # After them comes a pass over each option, with about so many trials.
    last = len(FACTORS) * len(task.parameters)
    total = task.trials + last

    def make(points: Sequence[Values]) -> list[TuningTrial]:
        done = len(study.trials)

        def advance(part: float, parts: float) -> None:
            progress(done + part / parts * len(points), total)

        outcomes = evaluator(points, advance)
        return [trial_of(objective, point, found, start) for point, found in zip(points, outcomes, strict=True)]

    front = len(objective.axes) > 1
    search(task.parameters, study, task.start, make, objective.losses, task.trials, task.seed, front)
    made = study.trials[: task.trials]
    best = min(made, key=lambda trial: objective.rank(trial.parts))
    if not best.losses:
        raise InputError(f"{task.tracker}: every trial failed; the first: {best.failed}", key="--range")

    def advance_last(part: float, parts: float) -> None:
        progress(task.trials + part / parts * last, total)

    best, responses = polished(evaluator, objective, start, best, advance_last)
    held_out = compare_held_out(Evaluator(test, task.tracker, task.parameters, executor, isolation), best.values)
    return Tuning(
        tracker=task.tracker,
        scenarios=tuple(bench.name for bench in train),
        objective=objective,
        parameters=task.parameters,
        start=task.start,
        best=best,
        trials=tuple(made),
        responses=tuple(responses),
        held_out=held_out,
        apart=tuple(apart),
        train_scenes=tuple(len(bench.truths) for bench in train),
        train_runs=tuple(bench.scenario.config.monte_carlo.runs for bench in train),
    )


def require_objective(objective: Objective, scenarios: Sequence[Scenario]) -> None:
    """Make sure that the scenarios can be tuned for the objective.

    Raises:
        InputError: one cannot; with the objectives that it can be tuned for.
    """
    for loaded in scenarios:
        hidden = loaded.config.sensing.identities == "hidden"
        if objective.hidden and not hidden:
            problem = f"{loaded.config.name} has labelled measurements; choose likelihood, position_rmse, "
            raise InputError(f"{problem}consistent_rmse or pareto", key="--objective")
        if hidden and not objective.hidden and objective.needs_truth:
            problem = f"{loaded.config.name} has detections that nobody labelled; choose gospa"
            raise InputError(f"{problem}, or likelihood without a truth", key="--objective")
        if objective.needs_truth and without_truth(loaded):
            raise InputError(f"{loaded.config.name} has no truth; choose likelihood", key="--objective")


def without_truth(loaded: Scenario) -> bool:
    """Whether a scenario is a log of measurements alone."""
    return bool(getattr(loaded.config.truth, "without_truth", False))


def _start(evaluator: Evaluator, objective: Objective) -> list[Sums]:
    """What the tracker gives as it is, against which each trial is held.

    Raises:
        InputError: it fails, or does not give what the objective needs.
    """
    found = []
    for bench, outcome in zip(evaluator.benches, evaluator.start, strict=True):
        where = f"{evaluator.tracker} in {bench.name}"
        if outcome.sums is None:
            raise InputError(f"{where} fails as it is: {outcome.failed}", file=bench.scenario.path)
        if not np.isfinite(outcome.sums.value(objective.measure)):
            raise InputError(_nothing(objective, bench, where), key="--objective")
        found.append(outcome.sums)
    return found


def _nothing(objective: Objective, bench: Bench, where: str) -> str:
    if objective.name == "likelihood":
        if bench.hidden:
            return f"{where} has no likelihood: of hidden identities only logs without a truth have one; choose gospa"
        return f"{where} gives no innovations, of which the likelihood is; choose position_rmse"
    return f"{where} has no {objective.measure}: nothing is scored"


def _signature(task: TuningTask, train: Sequence[Bench]) -> dict[str, Any]:
    """What determines the trials, by the words in which a difference is told."""
    scenarios = {
        bench.name: hashlib.sha256(
            json.dumps(
                [
                    {key: value for key, value in bench.scenario.document.value.items() if key != "trackers"},
                    plain(bench.scenario, task.tracker),
                    bench.scenario.config.truth.model_dump(mode="json", fallback=str),
                    bench.scenario.config.monte_carlo.model_dump(),
                ],
                sort_keys=True,
            ).encode()
        ).hexdigest()
        for bench in train
    }
    return {
        "objective": task.objective.name,
        "scenario": scenarios,
        "ranges": [item.as_json() for item in task.parameters],
        "seed": task.seed,
    }
