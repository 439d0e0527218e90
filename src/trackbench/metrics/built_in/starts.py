"""How soon a track begins, and how good it is at first."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from trackbench.base.types import Array
from trackbench.metrics.intervals import ratio, root
from trackbench.metrics.protocol import Chunk, Metric, Outcome, Scope, SquaredErrors


class StartMetric(Metric):
    """A metric of the first second after an object was detected, whatever the settling time.

    The sums are ``(2, runs)``: a total, and the number of its terms.
    """

    better = "smaller"
    at_least = 0.0
    of_squares = True
    nothing: ClassVar[str] = "no object was detected"

    def merge(self, blocks: Sequence[Array]) -> Array:
        return np.concatenate(blocks, axis=1)


class StartDelay(StartMetric):
    name, unit = "start_delay", "s"
    meaning = "time without an estimate in the first second after an object is detected, mean over objects"

    def init(self, scope: Scope) -> tuple[Array, Array]:
        """The sums, and ``(instants, 1)`` how long each instant lasts, s."""
        sums, starting, time = np.zeros((2, scope.runs)), scope.starting, scope.target.time
        begins = starting & ~np.concatenate([np.zeros_like(starting[:1]), starting[:-1]])
        sums[1] = begins.sum(axis=0).reshape(-1, scope.runs).sum(axis=0)
        return sums, np.diff(time, append=time[-1:])[:, None]

    def update(self, sums: tuple[Array, Array], chunk: Chunk | SquaredErrors) -> tuple[Array, Array]:
        silent = chunk.starting & ~chunk.given
        if silent.any():
            lasts = np.where(silent, sums[1][chunk.instants], 0.0)
            sums[0][0] += lasts.sum(axis=0).reshape(-1, chunk.runs).sum(axis=0)
        return sums

    def close(self, sums: tuple[Array, Array]) -> Array:
        return sums[0]

    def finish(self, sums: Array) -> Outcome:
        total, count = sums
        return ratio(total, count, at_least=0.0) if count.any() else self.no_value(self.nothing)


class StartPositionRmse(StartMetric):
    name, unit = "start_position_rmse", "m"
    meaning = "root mean square error of the position in the first second after an object is detected"

    def init(self, scope: Scope) -> Array:
        return np.zeros((2, scope.runs))

    def update(self, sums: Array, chunk: Chunk | SquaredErrors) -> Array:
        if chunk.starting.any():
            for row, terms in enumerate((chunk.squares[0], 1.0)):
                of_start = np.where(chunk.starting, terms, 0.0).sum(axis=0)
                sums[row] += of_start.reshape(-1, chunk.runs).sum(axis=0)
        return sums

    def finish(self, sums: Array) -> Outcome:
        total, count = sums
        return root(ratio(total, count, at_least=0.0)) if count.any() else self.no_value(self.nothing)
