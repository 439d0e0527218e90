"""Objectives: what a tracker is tuned for."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.metrics import Metric
from trackbench.metrics.protocol import Direction
from trackbench.metrics.registry import metrics_for
from trackbench.scenario import Scenario
from trackbench.subjects.tuning.evaluation import TrialOutcome
from trackbench.subjects.tuning.measures import MEASURES, OF_ALL, WORDS, Sums


@dataclass(frozen=True)
class Objective:
    """A loss of which the smallest value is searched.

    Over several scenarios it is a mean: of errors the geometric one relative to the start's.
    """

    name: str
    meaning: str
    """Half a sentence."""
    measure: str
    """Measure by which start and tuned values are compared first."""
    loss: Callable[[Sequence[Sums], Sequence[Sums]], float]
    """Function of the sums of a trial in each scenario, and of the start's."""
    needs_truth: bool = True
    hidden: bool = False
    """Whether detections have hidden identities."""
    metric: Metric | None = None
    """The metric of the measure, if it is not summed in any case."""

    @property
    def better(self) -> Direction | None:
        """Direction in which the measure gets better."""
        return (self.metric or MEASURES[self.measure]).better

    def __call__(self, outcomes: Sequence[TrialOutcome], start: Sequence[Sums]) -> float | str:
        """Return the loss of a trial; in words why it does not count."""
        sums = []
        for outcome, other in zip(outcomes, start, strict=True):
            if outcome.sums is None:
                return outcome.failed
            lacking = outcome.sums.lacking(other, self.measure)
            if lacking is not None:
                return lacking
            sums.append(outcome.sums)
        with np.errstate(divide="ignore", invalid="ignore"):
            loss = self.loss(sums, start)
        return loss if math.isfinite(loss) else "its value is not finite"


def _log_ratio(measure: str, sums: Sequence[Sums], start: Sequence[Sums]) -> float:
    ratios = [own.value(measure) / other.value(measure) for own, other in zip(sums, start, strict=True)]
    return float(np.mean(np.log(ratios)))


def error_objective(measure: str, meaning: str = "", hidden: bool = False, metric: Metric | None = None) -> Objective:
    """Return the objective of a measure with a better direction: its value over the start's.

    Args:
        measure: name of the measure.
        meaning: half a sentence; unless given, made of the name.
        hidden: whether detections have hidden identities.
        metric: of the measure, if it is not summed in any case.
    """
    sign = 1.0 if (metric or MEASURES[measure]).better == "smaller" else -1.0
    return Objective(
        measure,
        meaning or f"{'smallest' if sign > 0 else 'largest'} {WORDS[measure]}",
        measure,
        lambda sums, start: sign * _log_ratio(measure, sums, start),
        hidden=hidden,
        metric=metric,
    )


OBJECTIVES = {
    item.name: item
    for item in (
        Objective(
            "likelihood",
            "largest likelihood of the innovations",
            "log_likelihood",
            lambda sums, _: -float(np.mean([own.value("log_likelihood") for own in sums])),
            needs_truth=False,
        ),
        error_objective("position_rmse", "smallest position error"),
        error_objective("tgospa", "smallest T-GOSPA, for detections of hidden identities", hidden=True),
    )
}


def metric_objectives(scenario: Scenario) -> dict[str, Objective]:
    """Return the objectives that the metrics of a scenario make, by name: metrics of one value with a direction."""
    hidden = scenario.config.sensing.identities == "hidden"
    return {
        # Metrics of tracks, and some errors, are summed in any case.
        metric.name: error_objective(
            metric.name,
            hidden=hidden,
            metric=None if MEASURES.get(metric.name) is metric or metric.name in OF_ALL else metric,
        )
        for metric in (*metrics_for(scenario.config.properties), *scenario.config.score.metrics)
        if metric.columns and metric.better is not None and metric.name not in OBJECTIVES
    }
