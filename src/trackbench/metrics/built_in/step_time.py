"""Computing time of a tracker, with known and with hidden identities."""

from __future__ import annotations

from collections.abc import Sequence, Set
from typing import Any, ClassVar

import numpy as np

from trackbench.base.types import Array
from trackbench.metrics.intervals import Interval
from trackbench.metrics.protocol import Metric, Outcome, Scope


class StepTime(Metric):
    name, unit, better = "step_time", "us", "smaller"
    meaning = "time of one predict and update of one run"
    needs: ClassVar[Set[str]] = frozenset()
    compared: ClassVar[bool] = False
    of_squares = True

    def init(self, scope: Scope) -> Array:
        """Return two sums of zero: the computing time of the tracker, s, and its number of steps."""
        return np.zeros(2)

    def update(self, sums: Array, part: Any) -> Array:
        return np.asarray(sums + np.array((part.seconds, part.steps)))

    def merge(self, blocks: Sequence[Array]) -> Array:
        return np.asarray(np.sum(blocks, axis=0))

    def finish(self, sums: Array) -> Outcome:
        seconds, steps = sums
        return 1e6 * seconds / steps if steps and np.isfinite(seconds) else self.no_value("no step was taken")

    @property
    def columns(self) -> tuple[str, ...]:
        return ()

    def in_runs(self, path: str, sums: Any, interval: Interval | None, runs: int) -> dict[str, Array]:
        return {}
