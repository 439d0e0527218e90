"""The trials that were made, in the order in which they were proposed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trackbench.subjects.tuning.evaluation import Outcome
from trackbench.subjects.tuning.measures import Sums
from trackbench.subjects.tuning.objectives import Objective
from trackbench.subjects.tuning.parameters import Values


@dataclass(frozen=True)
class TuningTrial:
    """Values that were tried, and what came of them."""

    values: Mapping[str, Any]
    parts: Mapping[str, float] = field(default_factory=dict)
    """Quantities of the objective; empty where it failed."""
    losses: tuple[float, ...] = ()
    failed: str = ""
    measures: Mapping[str, float] = field(default_factory=dict)
    """Geometric mean over the scenarios of what start and tuned are compared by."""

    @property
    def loss(self) -> float:
        """The first loss; infinite where it failed."""
        return self.losses[0] if self.losses else math.inf


def trial_of(objective: Objective, values: Values, outcomes: Sequence[Outcome], start: Sequence[Sums]) -> TuningTrial:
    """What came of a trial, from its outcome in each scenario and the start's."""
    parts = objective(outcomes, start)
    if isinstance(parts, str):
        return TuningTrial(dict(values), failed=parts)
    sums = [outcome.sums for outcome in outcomes if outcome.sums is not None]
    return TuningTrial(dict(values), parts, objective.losses(parts), measures=measures_of(sums))


def measures_of(sums: Sequence[Sums]) -> dict[str, float]:
    """What start and tuned are compared by, over the scenarios: the geometric mean, of the likelihood the mean."""
    found = {}
    for name in sums[0].units if sums else ():
        values = np.array([one.value(name) for one in sums])
        if np.isfinite(values).all() and (name == "log_likelihood" or (values > 0).all()):
            found[name] = float(values.mean() if name == "log_likelihood" else np.exp(np.log(values).mean()))
    return found


def best_of(trials: Sequence[TuningTrial]) -> TuningTrial | None:
    """The trial with the smallest loss, the first of several; None where all failed."""
    done = [trial for trial in trials if trial.losses]
    return min(done, key=lambda trial: trial.loss) if done else None


def chosen_of(objective: Objective, trials: Sequence[TuningTrial]) -> TuningTrial | None:
    """The trial whose values are written, one of the front where there are two losses; None where all failed."""
    done = [trial for trial in trials if trial.losses]
    among = front_of(done) if len(objective.axes) > 1 else done
    return min(among, key=lambda trial: objective.rank(trial.parts)) if among else None


def front_of(trials: Sequence[TuningTrial]) -> list[TuningTrial]:
    """The trials that no other one beats in both losses, by the first one."""
    done = sorted((trial for trial in trials if trial.losses), key=lambda trial: trial.losses)
    front: list[TuningTrial] = []
    for trial in done:
        if not front or trial.losses[1] < front[-1].losses[1]:
            front.append(trial)
    return front
