"""The objectives for which a tracker can be tuned."""

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
    """Measure whose best value a tuning seeks.

    The loss of a trial is a mean over scenarios. For the likelihood it is the mean negative log-likelihood of a
    measurement; for an error, the mean logarithm of its ratio to the start's error.
    """

    name: str
    measure: str
    """Name of the measure by which start and tuned values are mainly compared."""
    metric: Metric | None = None
    """Metric of the measure; None for a measure that every trial sums."""

    @property
    def better(self) -> Direction | None:
        """Direction in which the measure improves: smaller or larger; None where neither is better."""
        return (self.metric or MEASURES[self.measure]).better

    @property
    def meaning(self) -> str:
        """Objective as part of a sentence: "smallest position RMSE"."""
        return f"{'smallest' if self.better == 'smaller' else 'largest'} {WORDS[self.measure]}"

    def __call__(self, outcomes: Sequence[TrialOutcome], start: Sequence[Sums]) -> float | str:
        """Return the loss of a trial from its outcomes and the start's sums by scenario; text if the trial failed."""
        values = []
        for outcome, start_sums in zip(outcomes, start, strict=True):
            if outcome.sums is None:
                return outcome.failed
            problem = outcome.sums.lacking(start_sums, self.measure)
            if problem is not None:
                return problem
            values.append(outcome.sums.value(self.measure))
        if self.measure != "log_likelihood":
            with np.errstate(divide="ignore", invalid="ignore"):
                values = np.log(np.divide(values, [start_sums.value(self.measure) for start_sums in start])).tolist()
        loss = float(np.mean(values)) * (1.0 if self.better == "smaller" else -1.0)
        return loss if math.isfinite(loss) else "its value is not finite"


def objective_of(name: str | None, scenarios: Sequence[Scenario]) -> Objective:
    """Return the objective of a name; for None T-GOSPA if all scenarios have it, else the likelihood.

    Raises:
        InputError: a scenario lacks the objective; the message names objectives that all have.
    """
    first, *others = map(_objectives, scenarios)
    common = {key: item for key, item in first.items() if all(key in other for other in others)}
    name = name or ("tgospa" if "tgospa" in common else "likelihood")
    if name not in common:
        where = " and ".join(item.config.name for item in scenarios)
        raise InputError(f"no objective {name!r} in {where}; {nearest_choices(name, common)}", key="--objective")
    return common[name]


def _objectives(scenario: Scenario) -> dict[str, Objective]:
    """Return the objectives of a scenario by name: metrics with one value and a direction, and the likelihood.

    Without a ground truth there is the likelihood alone; with hidden identities and a ground truth there is none.
    """
    likelihood = {"likelihood": Objective("likelihood", "log_likelihood")}
    if "truth" not in scenario.config.properties:
        return likelihood
    metrics = (*metrics_for(scenario.config.properties), *scenario.config.score.metrics)
    return ({} if scenario.config.sensing.identities == "hidden" else likelihood) | {
        # Every trial sums the metrics of tracks and some errors.
        item.name: Objective(
            item.name, item.name, None if MEASURES.get(item.name) is item or item.name in OF_ALL else item
        )
        for item in metrics
        if item.columns and item.better is not None
    }
