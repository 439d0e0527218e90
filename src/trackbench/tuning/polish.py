"""The last step of a search: each option by itself around the best values, which also gives the response."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from trackbench.metrics.intervals import Interval, paired
from trackbench.tuning.evaluation import Evaluator
from trackbench.tuning.measures import Sums
from trackbench.tuning.objectives import Objective
from trackbench.tuning.parameters import Values
from trackbench.tuning.response import Response, ResponsePoint, along, ordered, sorted_values
from trackbench.tuning.trials import TuningTrial, trial_of
from trackbench.types import Progress, no_progress

#: How often better values are followed that it meets.
PASSES = 4
#: A loss is smaller only by more than rounding.
ROUNDING = 1e-9


def polished(
    evaluator: Evaluator,
    objective: Objective,
    start: Sequence[Sums],
    best: TuningTrial,
    progress: Progress = no_progress,
) -> tuple[TuningTrial, list[Response]]:
    """The best values, or better ones in which options are changed one by one; and the response around them.

    Args:
        evaluator: on the scenes and noise that are tuned on.
        objective: what for.
        start: what the tracker gives as it is.
        best: of the search.
        progress: called with how many parts of a pass are done and how many there are.
    """
    for last in range(PASSES):
        lines = [along(item, best.values) for item in evaluator.parameters]
        points: list[Values] = [best.values, *(point for line in lines for point in line)]
        outcomes = evaluator(points, progress)
        trials = [trial_of(objective, point, found, start) for point, found in zip(points, outcomes, strict=True)]
        better = min(trials, key=lambda trial: objective.rank(trial))
        if objective.rank(better) < objective.rank(trials[0]) - ROUNDING and last < PASSES - 1:
            best = better
            continue
        break
    sums = [[outcome.sums for outcome in found] for found in outcomes]
    responses, first = [], 1
    for item, line in zip(evaluator.parameters, lines, strict=True):
        here = range(first, first + len(line))
        first += len(line)
        own = ResponsePoint(best.values[item.key], objective.rank(trials[0]), 0.0, None, best=True)
        found = [own]
        for i in here:
            loss = objective.rank(trials[i])
            reach = _reach(evaluator, objective, sums[i], sums[0]) if trials[i].losses else None
            rise = loss - own.loss if math.isfinite(loss) else math.nan
            found.append(ResponsePoint(trials[i].values[item.key], loss if trials[i].losses else math.nan, rise, reach))
        responses.append(Response(item, sorted_values(item, found)))
    return best, ordered(responses)


def _reach(
    evaluator: Evaluator, objective: Objective, own: Sequence[Sums | None], best: Sequence[Sums | None]
) -> float | None:
    """Half of the 95 % interval of the difference of two losses on the same runs, as far as the main measure goes."""
    squares = []
    for number, (one, other) in enumerate(zip(own, best, strict=True)):
        if one is None or other is None:
            return None
        intervals = [each.interval(objective.measure, evaluator.scenes(number)) for each in (one, other)]
        known = [_as_loss(each, objective) for each in intervals if each is not None]
        found = paired(known[0], known[1]).ci95 if len(known) == 2 else None
        if found is None:
            return None
        squares.append((found[1] - found[0]) ** 2 / 4)
    return math.sqrt(sum(squares)) / len(squares)


def _as_loss(interval: Interval, objective: Objective) -> Interval:
    """The measure on the scale of the loss: of an error its logarithm."""
    if objective.measure == "log_likelihood":
        return interval
    return Interval(float(np.log(interval.value)), interval.influence / interval.value, weight=interval.weight)
