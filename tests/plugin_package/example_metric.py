"""A metric: the largest error of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base.config import NonNegative
from trackbench.base.types import Array
from trackbench.metrics import Chunk, Interval, Metric, Scope, ratio
from trackbench.metrics.protocol import Direction


class LargestError(Metric):
    """Mean over the runs of the largest position error in each."""

    name: ClassVar[str] = "largest_error"
    unit: ClassVar[str] = "m"
    meaning: ClassVar[str] = "mean over the runs of the largest position error in each"
    better: ClassVar[Direction | None] = "smaller"

    after_s: NonNegative = Field(0, description="Time of the scenario from which errors count, s.")

    def init(self, scope: Scope) -> Array:
        return np.full(scope.runs, np.nan)

    def update(self, sums: Array, chunk: Chunk) -> Array:
        counted = chunk.scored & (chunk.time[:, None] >= self.after_s)
        distance = np.where(counted, np.hypot(chunk.error[0], chunk.error[1]), np.nan)
        # Of a number and NaN, fmax gives the number.
        return np.fmax(sums, np.fmax.reduce(distance.reshape(-1, chunk.runs)))

    def merge(self, blocks: Sequence[Array]) -> Array:
        return np.concatenate(blocks)

    def finish(self, sums: Array) -> Interval:
        return ratio(sums, np.ones_like(sums))
