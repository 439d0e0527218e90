"""Tunes one tracker: the search on some scenes and noise, and the proof on others."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.execution import Executor
from trackbench.base.types import Array, Indices, NotedProgress, Progress, no_progress
from trackbench.driving.isolation import ISOLATED, Isolation
from trackbench.engine.choice import EngineName
from trackbench.engine.equations import ComputedBy
from trackbench.metrics.contrasts import paired
from trackbench.metrics.intervals import Interval
from trackbench.runner.assemble import log_left_to_numpy
from trackbench.scenario import Scenario
from trackbench.subjects.tuning.entry import Values
from trackbench.subjects.tuning.evaluation import Bench, Evaluator, Outcome
from trackbench.subjects.tuning.held_out import HeldOut, compare_held_out, number_of_parts
from trackbench.subjects.tuning.measures import Sums
from trackbench.subjects.tuning.objectives import Objective, source_of_part
from trackbench.subjects.tuning.parameters import Parameter
from trackbench.subjects.tuning.search import FACTORS, Response, ResponsePoint, search, values_along
from trackbench.subjects.tuning.study import (
    Study,
    TuningTrial,
    chosen_of,
    front_of,
    measures_of,
    study_signature,
    trial_of,
)

#: How often better values are followed that it meets.
PASSES = 4
#: A loss is smaller only by more than rounding.
ROUNDING = 1e-9
#: Of a numerical derivative.
STEP = 1e-4


def polished(
    evaluator: Evaluator,
    objective: Objective,
    start: Sequence[Sums],
    made: Sequence[TuningTrial],
    best: TuningTrial,
    progress: Progress = no_progress,
) -> tuple[TuningTrial, list[Response]]:
    """The best values, or better ones in which options are changed one by one; and the response around them.

    Args:
        evaluator: on the scenes and noise that are tuned on.
        objective: what for.
        start: what the tracker gives as it is.
        made: the trials of the search; what is chosen is on their front, where there are two losses.
        best: of these.
        progress: called with how many parts of a pass are done and how many there are.
    """
    for last in range(PASSES):
        lines = [values_along(item, best.values) for item in evaluator.parameters]
        points: list[Values] = [best.values, *(point for line in lines for point in line)]
        outcomes = evaluator(points, progress)
        trials = [trial_of(objective, *pair, start) for pair in zip(points, outcomes, strict=True)]
        better = chosen_of(objective, [*trials, *made])
        if better is None or last == PASSES - 1:
            break
        if len(objective.axes) > 1:
            moves = better.values != trials[0].values
        else:
            moves = objective.rank(better.parts) < objective.rank(trials[0].parts) - ROUNDING
        if not moves:
            break
        best = better
    responses, first = [], 1
    for item, line in zip(evaluator.parameters, lines, strict=True):
        around = [ResponsePoint(best.values[item.key], trials[0].parts, 0.0, None, best=True)]
        for i in range(first, first + len(line)):
            value, parts = trials[i].values[item.key], trials[i].parts
            if not parts:
                around.append(ResponsePoint(value, parts, math.nan, None))
                continue
            rise = objective.rank(parts) - objective.rank(trials[0].parts)
            sides = (trials[i], outcomes[i]), (trials[0], outcomes[0])
            around.append(ResponsePoint(value, parts, rise, _reach(evaluator, objective, *sides)))
        first += len(line)
        # In the order of the values, or of the choices.
        if item.scale == "choice":
            around.sort(key=lambda point: item.choices.index(point.value))
        else:
            around.sort(key=lambda point: float(point.value))
        responses.append(Response(item, tuple(around)))
    # The option that matters most comes first.
    return best, sorted(responses, key=lambda response: -np.nan_to_num(response.steepness, nan=math.inf))


def _reach(
    evaluator: Evaluator,
    objective: Objective,
    own: tuple[TuningTrial, Sequence[Outcome]],
    best: tuple[TuningTrial, Sequence[Outcome]],
) -> float | None:
    """Half of the 95 % interval of the difference of two losses on the same runs; None where the runs tell of none.

    By the delta method; scenarios are independent.
    """
    square = 0.0
    for number in range(len(evaluator.benches)):
        scene = evaluator.scenes(number)
        several = len(np.unique(scene)) > 1
        sides = [_influence(objective, *side, number, scene) for side in (own, best)]
        first, second = (Interval(0.0, side, scenes=several) for side in sides)
        ends = paired(first, second).ci95
        if ends is None:
            return None
        square += (ends[1] - ends[0]) ** 2 / 4
    return math.sqrt(square)


def _influence(
    objective: Objective, trial: TuningTrial, outcomes: Sequence[Outcome], number: int, scene: Indices
) -> Array:
    """``(scenes or runs,)`` what each adds to the loss, by one of the scenarios."""
    total: Array | float = 0.0
    for part in trial.parts:
        source, sums = source_of_part(part, objective, len(outcomes)), outcomes[number].sums
        if number not in source.scenarios or sums is None:
            continue
        interval = sums.interval(source.measure, scene)
        if interval is not None:
            scale = source.sign / len(source.scenarios) / (interval.value if source.logarithm else 1.0)
            # How the loss changes with the part.
            ends = [objective.rank({**trial.parts, part: trial.parts[part] + step}) for step in (STEP, -STEP)]
            total = total + (ends[0] - ends[1]) / (2 * STEP) * scale * interval.corrected
    return np.asarray(total)


@dataclass(frozen=True, kw_only=True)
class TuningTask:
    """The tuning of one tracker."""

    tracker: str
    objective: Objective
    parameters: tuple[Parameter, ...]
    start: dict[str, Any] | None
    """The values that it has; None where one of them is in no range."""
    count: int
    """Of trials."""
    seed: int = 0
    storage: Path | None = None
    notes: tuple[str, ...] = ()
    """What should be known of the ranges."""


@dataclass(frozen=True, kw_only=True)
class Tuning(TuningTask):
    """What the tuning of one tracker found."""

    scenarios: tuple[str, ...]
    start_measures: Mapping[str, float]
    """What the start gives on what was tuned on, as a trial's ``measures``."""
    best: TuningTrial
    trials: tuple[TuningTrial, ...]
    responses: tuple[Response, ...]
    """Along each parameter; the one that matters most comes first."""
    held_out: HeldOut
    apart: tuple[str, ...]
    """Of each scenario what tells the scenes and noise tried on from those tuned on; empty where nothing does."""
    train_scenes: tuple[int, ...]
    train_runs: tuple[int, ...]
    engine: ComputedBy | None
    """What computed a built-in tracker; None of any other."""

    @property
    def edges(self) -> list[tuple[Parameter, float]]:
        """The parameters whose best value is at an end of its range that could be wider."""
        edges = [(item, item.edge(self.best.values[item.key])) for item in self.parameters]
        return [(item, edge) for item, edge in edges if edge is not None]

    @property
    def front(self) -> list[TuningTrial]:
        """The trials that no other beats in both losses; empty where there is one."""
        return front_of([*self.trials, self.best]) if len(self.objective.axes) > 1 else []


def tune_tracker(
    task: TuningTask,
    benches: Sequence[tuple[Bench, Bench, str]],
    executor: Executor,
    isolation: Isolation = ISOLATED,
    engine: EngineName = "auto",
    progress: NotedProgress = no_progress,
) -> Tuning:
    """Search the best values on some scenes and noise, and hold them against the start's on others.

    Args:
        task: what is tuned, and for what.
        benches: of each scenario what to tune on, what to try on, and what tells the two apart.
        executor: what makes the trials.
        isolation: how a tracker that is not built in is kept apart.
        engine: what computes.
        progress: called with the number of trials made and of all, and what the best gives.

    Raises:
        InputError: the tracker fails as it is, does not give what the objective needs, or the storage does not fit.
    """
    objective = task.objective
    wanted = objective.metric, objective.measure
    train, test, apart = zip(*benches, strict=True)
    evaluator = Evaluator(train, task.tracker, task.parameters, executor, isolation, engine, task.count, *wanted)
    start = _start(evaluator, objective)
    used = evaluator.engine_used
    if used is not None:
        log_left_to_numpy("tuning", task.tracker, used)
    signature = study_signature(task.tracker, objective.name, task.parameters, task.seed, train, start)
    study = Study(task.tracker, task.storage, task.parameters, objective.axes, signature)

    # After them comes a pass over each option, with about so many trials.
    last = len(FACTORS) * len(task.parameters)
    total = task.count + last

    def advance_from(done: int, size: int) -> Progress:
        reached = chosen_of(objective, study.trials)
        note = "" if reached is None else f"best {reached.measures[objective.measure]:.4g}"
        return lambda part, parts: progress(done + part / parts * size, total, note)

    def make(points: Sequence[Values]) -> list[TuningTrial]:
        outcomes = evaluator(points, advance_from(len(study.trials), len(points)))
        return [trial_of(objective, *pair, start) for pair in zip(points, outcomes, strict=True)]

    front = len(objective.axes) > 1
    search(task.parameters, study, task.start, make, objective.losses, task.count, task.seed, front)
    made = study.trials[: task.count]
    best = chosen_of(objective, made)
    if best is None:
        raise InputError(f"{task.tracker}: every trial failed; the first: {made[0].failed}", key="--range")

    best, responses = polished(evaluator, objective, start, made, best, advance_from(task.count, last))
    others = Evaluator(test, task.tracker, task.parameters, executor, isolation, evaluator.engine, 1, *wanted)
    progress(total, total, "now on what is held out")
    held_out = compare_held_out(others, best.values)
    return Tuning(
        **vars(task),
        scenarios=tuple(bench.name for bench in train),
        start_measures=measures_of(start),
        best=best,
        trials=tuple(made),
        responses=tuple(responses),
        held_out=held_out,
        apart=apart,
        train_scenes=tuple(number_of_parts(bench.scenario.config) for bench in train),
        train_runs=tuple(bench.scenario.config.monte_carlo.runs for bench in train),
        engine=None if used is None else used.engine,
    )


def require_objective(objective: Objective, scenarios: Sequence[Scenario]) -> None:
    """Make sure that the scenarios can be tuned for the objective.

    Raises:
        InputError: one cannot; with the objectives that it can be tuned for.
    """
    for loaded in scenarios:
        hidden, name = loaded.config.sensing.identities == "hidden", loaded.config.name
        if lacks_truth(loaded):
            problem = f"{name} has no truth; choose likelihood" if objective.needs_truth else ""
        elif hidden:
            problem = "" if objective.hidden else f"{name} has a truth and hidden identities; choose tgospa"
        else:
            choices = "likelihood, position_rmse, consistent_rmse or pareto"
            problem = f"{name} has labelled measurements; choose {choices}" if objective.hidden else ""
        if problem:
            raise InputError(problem, key="--objective")


def lacks_truth(loaded: Scenario) -> bool:
    """Whether a scenario is a log of measurements alone."""
    return bool(getattr(loaded.config.truth, "without_truth", False))


def _start(evaluator: Evaluator, objective: Objective) -> list[Sums]:
    """What the tracker gives as it is, against which each trial is held.

    Raises:
        InputError: it fails, or does not give what the objective needs.
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
                problem = f"{where} does not predict its detections, of which predictions the likelihood is"
            else:
                problem = f"{where} gives no innovations, of which the likelihood is; choose position_rmse"
            raise InputError(problem, key="--objective")
        sums.append(outcome.sums)
    return sums
