"""The trials of a tuning: sets of option values, each with its loss."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class TuningTrial:
    """Trial of a tuning: values of the options, and their loss."""

    values: Mapping[str, Any]
    loss: float = math.inf
    """Loss, smaller is better; infinite where the trial failed."""
    failed: str = ""
    """Reason of the trial's failure; empty where it did not fail."""

    @classmethod
    def of(cls, values: Mapping[str, Any], loss: float | str) -> TuningTrial:
        """Return a trial from its values, and its loss or the reason of its failure."""
        return cls(dict(values), failed=loss) if isinstance(loss, str) else cls(dict(values), loss)


def best_trial(trials: Sequence[TuningTrial]) -> TuningTrial | None:
    """Return the trial with the smallest loss, the first of equals; None where all failed."""
    return min((trial for trial in trials if not trial.failed), key=lambda trial: trial.loss, default=None)
