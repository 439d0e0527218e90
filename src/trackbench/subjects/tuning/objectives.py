"""Objectives: what a tracker is tuned for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackbench.base.errors import InputError, nearest_choices
from trackbench.metrics import Metric
from trackbench.metrics.protocol import Direction
from trackbench.metrics.registry import metrics_for
from trackbench.scenario import Scenario
from trackbench.subjects.tuning.evaluation import TrialOutcome
from trackbench.subjects.tuning.measures import MEASURES, OF_ALL, WORDS, Sums


@dataclass(frozen=True)
class Objective:
    """The measure whose best value is searched.

    The loss of a trial is the mean over the scenarios: of the negative log-likelihood of a measurement, and of an error
    the logarithm of its ratio to the start's.
    """

    name: str
    measure: str
    """Measure by which start and tuned values are compared first."""
    metric: Metric | None = None
    """Metric of the measure, if it is not summed in any case."""

    @property
    def better(self) -> Direction | None:
        """Direction in which the measure gets better."""
        return (self.metric or MEASURES[self.measure]).better

    @property
    def meaning(self) -> str:
        """Half a sentence: "smallest position RMSE"."""
        return f"{'smallest' if self.better == 'smaller' else 'largest'} {WORDS[self.measure]}"

    def __call__(self, outcomes: Sequence[TrialOutcome], start: Sequence[Sums]) -> float | str:
        """Return the loss of a trial; in words why it does not count."""
        values = []
        for outcome, other in zip(outcomes, start, strict=True):
            if outcome.sums is None:
                return outcome.failed
            lacking = outcome.sums.lacking(other, self.measure)
            if lacking is not None:
                return lacking
            values.append(outcome.sums.value(self.measure))
        if self.measure != "log_likelihood":
            with np.errstate(divide="ignore", invalid="ignore"):
                values = np.log(np.divide(values, [other.value(self.measure) for other in start])).tolist()
        loss = float(np.mean(values)) * (1.0 if self.better == "smaller" else -1.0)
        return loss if math.isfinite(loss) else "its value is not finite"


def objective_of(name: str | None, scenarios: Sequence[Scenario]) -> Objective:
    """Return the objective of a name; unless given, T-GOSPA where there is one, and else the likelihood.

    Raises:
        InputError: a scenario does not have it; with those that all have.
    """
    first, *others = map(_objectives, scenarios)
    common = {key: item for key, item in first.items() if all(key in other for other in others)}
    name = name or ("tgospa" if "tgospa" in common else "likelihood")
    if name not in common:
        where = " and ".join(item.config.name for item in scenarios)
        raise InputError(f"no objective {name!r} in {where}; {nearest_choices(name, common)}", key="--objective")
    return common[name]


def _objectives(scenario: Scenario) -> dict[str, Objective]:
    """Return the likelihood and the metrics of one value with a direction, by name; without a truth, the likelihood.

    The detections of hidden identities whose truth is known have no likelihood.
    """
    likelihood = {"likelihood": Objective("likelihood", "log_likelihood")}
    if "truth" not in scenario.config.properties:
        return likelihood
    metrics = (*metrics_for(scenario.config.properties), *scenario.config.score.metrics)
    return ({} if scenario.config.sensing.identities == "hidden" else likelihood) | {
        # Metrics of tracks, and some errors, are summed in any case.
        item.name: Objective(
            item.name, item.name, None if MEASURES.get(item.name) is item or item.name in OF_ALL else item
        )
        for item in metrics
        if item.columns and item.better is not None
    }
