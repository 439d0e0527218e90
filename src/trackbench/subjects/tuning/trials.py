"""The trials of a tuning: values that were tried, and their loss."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trackbench.subjects.tuning.entry import Values
from trackbench.subjects.tuning.evaluation import TrialOutcome
from trackbench.subjects.tuning.measures import Sums
from trackbench.subjects.tuning.objectives import Objective


@dataclass(frozen=True)
class TuningTrial:
    """Values that were tried, and their loss."""

    values: Mapping[str, Any]
    loss: float = math.inf
    """Infinite where the trial failed."""
    failed: str = ""
    """Reason of a failure."""
    measures: Mapping[str, float] = field(default_factory=dict)
    """Mean over the scenarios of each measure, as :func:`mean_measures` takes it."""


def trial_of(
    objective: Objective, values: Values, outcomes: Sequence[TrialOutcome], start: Sequence[Sums]
) -> TuningTrial:
    """Return the trial of some values, from its outcome in each scenario and the start's."""
    loss = objective(outcomes, start)
    if isinstance(loss, str):
        return TuningTrial(dict(values), failed=loss)
    return TuningTrial(
        dict(values), loss, measures=mean_measures([item.sums for item in outcomes if item.sums is not None])
    )


def mean_measures(sums: Sequence[Sums]) -> dict[str, float]:
    """Return the geometric mean over the scenarios of each measure that is positive; of a likelihood, the mean."""
    means = {}
    for name in sums[0].measures if sums else ():
        values = np.array([item.value(name) for item in sums])
        if np.isfinite(values).all() and (name == "log_likelihood" or (values > 0).all()):
            means[name] = float(values.mean() if name == "log_likelihood" else np.exp(np.log(values).mean()))
    return means


def best_trial(trials: Sequence[TuningTrial]) -> TuningTrial | None:
    """Return the first of the trials with the smallest loss; None where all failed."""
    return min((trial for trial in trials if not trial.failed), key=lambda trial: trial.loss, default=None)
