"""The last step of a search: each option by itself around the best values, which also gives the response."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Array, Indices, Progress, no_progress
from trackbench.metrics.intervals import Interval, paired
from trackbench.subjects.tuning.evaluation import Evaluator, Outcome
from trackbench.subjects.tuning.measures import Sums
from trackbench.subjects.tuning.objectives import Objective, source_of
from trackbench.subjects.tuning.parameters import Values
from trackbench.subjects.tuning.response import Response, ResponsePoint, along, ordered, sorted_values
from trackbench.subjects.tuning.trials import TuningTrial, chosen_of, trial_of

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
        lines = [along(item, best.values) for item in evaluator.parameters]
        points: list[Values] = [best.values, *(point for line in lines for point in line)]
        outcomes = evaluator(points, progress)
        trials = [trial_of(objective, point, found, start) for point, found in zip(points, outcomes, strict=True)]
        better = chosen_of(objective, [*trials, *made])
        if better is None or last == PASSES - 1 or not _moves(objective, trials[0], better):
            break
        best = better
    responses, first = [], 1
    for item, line in zip(evaluator.parameters, lines, strict=True):
        found = [ResponsePoint(best.values[item.key], trials[0].parts, 0.0, None, best=True)]
        for i in range(first, first + len(line)):
            value, parts = trials[i].values[item.key], trials[i].parts
            if not parts:
                found.append(ResponsePoint(value, parts, math.nan, None))
                continue
            rise = objective.rank(parts) - objective.rank(trials[0].parts)
            sides = (trials[i], outcomes[i]), (trials[0], outcomes[0])
            found.append(ResponsePoint(value, parts, rise, _reach(evaluator, objective, *sides)))
        first += len(line)
        responses.append(Response(item, sorted_values(item, found)))
    return best, ordered(responses)


def _moves(objective: Objective, best: TuningTrial, better: TuningTrial) -> bool:
    """Whether the values that are chosen are others than the best ones so far, by more than rounding."""
    if len(objective.axes) > 1:
        return better.values != best.values
    return objective.rank(better.parts) < objective.rank(best.parts) - ROUNDING


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
        sides = [_influence(objective, trial, found, number, scene) for trial, found in (own, best)]
        found = paired(Interval(0.0, sides[0]), Interval(0.0, sides[1])).ci95
        if found is None:
            return None
        square += (found[1] - found[0]) ** 2 / 4
    return math.sqrt(square)


def _influence(
    objective: Objective, trial: TuningTrial, outcomes: Sequence[Outcome], number: int, scene: Indices
) -> Array:
    """``(scenes or runs,)`` what each adds to the loss, by one of the scenarios."""
    total: Array | float = 0.0
    for part in trial.parts:
        source, sums = source_of(part, objective, len(outcomes)), outcomes[number].sums
        if number not in source.scenarios or sums is None:
            continue
        interval = sums.interval(source.measure, scene)
        if interval is not None:
            scale = source.sign / len(source.scenarios) / (interval.value if source.logarithm else 1.0)
            total = total + _slope(objective, trial, part) * scale * interval.corrected
    return np.asarray(total)


def _slope(objective: Objective, trial: TuningTrial, part: str) -> float:
    """How the loss changes with one of its parts."""
    ends = [objective.rank({**trial.parts, part: trial.parts[part] + step}) for step in (STEP, -STEP)]
    return (ends[0] - ends[1]) / (2 * STEP)
