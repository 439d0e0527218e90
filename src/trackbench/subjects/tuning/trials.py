"""The trials of a tuning: values that were tried, and their loss."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class TuningTrial:
    """Values that were tried, and their loss."""

    values: Mapping[str, Any]
    loss: float = math.inf
    """Infinite where the trial failed."""
    failed: str = ""
    """Reason of a failure."""

    @classmethod
    def of(cls, values: Mapping[str, Any], loss: float | str) -> TuningTrial:
        """Return the trial of some values, from its loss or the reason of its failure."""
        return cls(dict(values), failed=loss) if isinstance(loss, str) else cls(dict(values), loss)


def best_trial(trials: Sequence[TuningTrial]) -> TuningTrial | None:
    """Return the first of the trials with the smallest loss; None where all failed."""
    return min((trial for trial in trials if not trial.failed), key=lambda trial: trial.loss, default=None)
