"""What a tracker is tuned for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.metrics import Metric
from trackbench.metrics.protocol import Direction
from trackbench.metrics.registry import metrics_for
from trackbench.metrics.verdicts import TOLERANCE
from trackbench.scenario import Scenario
from trackbench.subjects.tuning.evaluation import Outcome
from trackbench.subjects.tuning.measures import (
    MEASURES,
    NEES_DOF,
    OF_ALL,
    WORDS,
    Sums,
    condition_excess,
    log_nees_by_condition,
)

#: A trial's quantities, which change smoothly with the values that are tuned, by name.
Parts = Mapping[str, float]
#: With the number of the scenario, the part that is the logarithm of its mean NEES over the degrees of freedom.
NEES = "nees "
#: The same of its mean under a condition, whose name follows the number.
UNDER = "under "
#: How much it counts that a mean NEES, that which is furthest from what a verdict tolerates, is off by a further per
#: cent, beside an error that is larger by one. Without end it would ruin the error of a tracker that no noise makes
#: consistent.
PRICE = 4.0
#: How far the logarithm of the mean NEES over its degrees of freedom may be off: half of what the verdict tolerates,
#: so that it holds on other scenes too.
SLACK = math.log(1.0 + TOLERANCE / 2)


@dataclass(frozen=True)
class Objective:
    """A quantity, or two, of which the smallest value is looked for.

    Over several scenarios it is a mean: of errors the geometric one relative to the start's.
    """

    name: str
    meaning: str
    """In half a sentence."""
    measure: str
    """What start and tuned are compared by first."""
    parts: Callable[[Sequence[Sums], Sequence[Sums]], Parts]
    """From the sums of each scenario, and those of the start."""
    losses: Callable[[Parts], tuple[float, ...]]
    """One, or two for a front."""
    axes: tuple[str, ...]
    """What each loss is."""
    needs_truth: bool = True
    hidden: bool = False
    """Whether it is of detections that nobody labelled."""
    metric: Metric | None = None
    """Of one that a metric makes, the metric."""

    @property
    def better(self) -> Direction | None:
        """Which values of its measure are better."""
        return (self.metric or MEASURES[self.measure]).better

    def rank(self, parts: Parts) -> float:
        """By which the best trial is chosen: the loss; of a front the error with a price on the inconsistency."""
        if not parts:
            return math.inf
        return (self.losses if len(self.axes) == 1 else _consistent)(parts)[0]

    def __call__(self, outcomes: Sequence[Outcome], start: Sequence[Sums]) -> Parts | str:
        """The parts of a trial; why it does not count."""
        sums = []
        for outcome, other in zip(outcomes, start, strict=True):
            if outcome.sums is None:
                return outcome.failed
            lacking = outcome.sums.lacking(other, [self.measure, *(["nees"] if self.parts is _error_and_nees else [])])
            if lacking is not None:
                return lacking
            sums.append(outcome.sums)
        parts = self.parts(sums, start)
        return parts if all(map(math.isfinite, parts.values())) else "its value is not finite"


class PartSource(NamedTuple):
    """Of what a part of the objective is made."""

    measure: str
    scenarios: Sequence[int]
    """By their number; the part is the mean over them."""
    logarithm: bool
    """Whether it is that of the measure."""
    sign: float = 1.0


class NeesDeviation(NamedTuple):
    """A mean NEES, over all estimates or under a condition, as the logarithm of it over its degrees of freedom."""

    scenario: int
    condition: str
    """Empty over all estimates."""
    value: float


def nees_deviations(parts: Parts) -> Iterator[NeesDeviation]:
    """How far each mean NEES of a trial is off."""
    for name, value in parts.items():
        if name.startswith(NEES):
            yield NeesDeviation(int(name.removeprefix(NEES)), "", value)
        elif name.startswith(UNDER):
            number, condition = name.removeprefix(UNDER).split(" ", 1)
            yield NeesDeviation(int(number), condition, value)


def source_of_part(part: str, objective: Objective, scenarios: int) -> PartSource:
    """The measure behind a part of an objective over so many scenarios."""
    for nees in nees_deviations({part: 0.0}):
        return PartSource(nees.condition or "nees", [nees.scenario], logarithm=True)
    if part == "likelihood":
        return PartSource(objective.measure, range(scenarios), logarithm=False, sign=-1.0)
    return PartSource(objective.measure, range(scenarios), logarithm=True)


def _error(measure: str) -> Callable[[Sequence[Sums], Sequence[Sums]], Parts]:
    def parts(sums: Sequence[Sums], start: Sequence[Sums]) -> Parts:
        ratios = [own.value(measure) / other.value(measure) for own, other in zip(sums, start, strict=True)]
        with np.errstate(divide="ignore", invalid="ignore"):
            return {"error": float(np.mean(np.log(ratios)))}

    return parts


def _error_and_nees(sums: Sequence[Sums], start: Sequence[Sums]) -> Parts:
    with np.errstate(divide="ignore", invalid="ignore"):
        nees = {f"{NEES}{i}": float(np.log(own.value("nees") / NEES_DOF)) for i, own in enumerate(sums)}
        under = {
            f"{UNDER}{i} {name}": value
            for i, (own, other) in enumerate(zip(sums, start, strict=True))
            for name, value in log_nees_by_condition(own, other)
        }
    return {**_error("position_rmse")(sums, start), **nees, **under}


def has_nees(parts: Parts) -> bool:
    """Whether a mean NEES is among the parts."""
    return any(name.startswith(NEES) for name in parts)


def mean_nees(parts: Parts) -> float:
    """Over the scenarios, the geometric mean of the mean NEES."""
    return NEES_DOF * math.exp(np.mean([value for name, value in parts.items() if name.startswith(NEES)]))


def _consistent(parts: Parts) -> tuple[float, ...]:
    worst: dict[int, float] = {}
    for scenario, condition, value in nees_deviations(parts):
        off = condition_excess(value) if condition else max(0.0, abs(value) - SLACK)
        worst[scenario] = max(off, worst.get(scenario, 0.0))
    return (parts["error"] + PRICE * float(np.mean(list(worst.values()))),)


def _both(parts: Parts) -> tuple[float, ...]:
    nees = [abs(value) for name, value in parts.items() if name.startswith(NEES)]
    return parts["error"], float(np.mean(nees))


def error_objective(measure: str, meaning: str = "", hidden: bool = False, metric: Metric | None = None) -> Objective:
    """The objective that a measure with a better direction makes: its value over the start's.

    Args:
        measure: name of it.
        meaning: unless given, of its name.
        hidden: whether it is of detections that nobody labelled.
        metric: of one that is not summed in any case.
    """
    sign = 1.0 if (metric or MEASURES[measure]).better == "smaller" else -1.0
    return Objective(
        measure,
        meaning or f"{'smallest' if sign > 0 else 'largest'} {WORDS[measure]}",
        measure,
        _error(measure),
        lambda parts: (sign * parts["error"],),
        (f"{WORDS[measure]} over the start's",),
        hidden=hidden,
        metric=metric,
    )


ERROR_AXIS, NEES_AXIS = "position RMSE over the start's", "factor by which the mean NEES is off"

OBJECTIVES = {
    item.name: item
    for item in (
        Objective(
            "likelihood",
            "largest likelihood of the innovations",
            "log_likelihood",
            lambda sums, _: {"likelihood": -float(np.mean([own.value("log_likelihood") for own in sums]))},
            lambda parts: (parts["likelihood"],),
            ("log-likelihood of a measurement",),
            needs_truth=False,
        ),
        error_objective("position_rmse", "smallest position error"),
        Objective(
            "consistent_rmse",
            "smallest position error with a mean NEES that is consistent in every condition, or near to it",
            "position_rmse",
            _error_and_nees,
            _consistent,
            (ERROR_AXIS,),
        ),
        error_objective("tgospa", "smallest T-GOSPA, for detections of hidden identities", hidden=True),
        Objective(
            "pareto",
            "front of position error and consistency of the mean NEES",
            "position_rmse",
            _error_and_nees,
            _both,
            (ERROR_AXIS, NEES_AXIS),
        ),
    )
}


def metric_objectives(scenario: Scenario) -> dict[str, Objective]:
    """By name, the objectives that the metrics of a scenario make: those of one value whose direction is known."""
    hidden = scenario.config.sensing.identities == "hidden"
    return {
        # Those of tracks, and some errors, are summed in any case.
        metric.name: error_objective(
            metric.name,
            hidden=hidden,
            metric=None if MEASURES.get(metric.name) is metric or metric.name in OF_ALL else metric,
        )
        for metric in (*metrics_for(scenario.config.properties), *scenario.config.score.metrics)
        if metric.columns and metric.better is not None and metric.name not in OBJECTIVES
    }
