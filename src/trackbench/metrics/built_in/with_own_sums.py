"""The error that 95 % of the estimates of a run stay below."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from trackbench.base.types import Array
from trackbench.metrics.intervals import ratio
from trackbench.metrics.protocol import Chunk, Metric, Outcome, Scope, SquaredErrors

SHARE = 0.95


class ErrorPercentile(Metric):
    """The 95th percentile of an error over the instants and objects of a run at which an estimate counts.

    Each run has its own, and the metric is their mean. So blocks of runs merge exactly, and the interval is that of a
    mean over runs. It is not the percentile of the errors of all runs together, which weighs the tail of bad runs more.
    """

    better = "smaller"
    at_least = 0.0
    of_squares = True
    row: ClassVar[int]
    """Of the squared errors."""

    def init(self, scope: Scope) -> list[Array]:
        """Squared errors ``(instants, batch)`` of each chunk, NaN where none counts; and the number of runs."""
        return [np.zeros(scope.runs)]

    def update(self, sums: list[Array], chunk: Chunk | SquaredErrors) -> list[Array]:
        squares = chunk.squares[self.row]
        sums.append(squares if chunk.scored.all() else np.where(chunk.scored, squares, np.nan))
        return sums

    def close(self, sums: list[Array]) -> Array:
        """``(runs,)`` percentile of each run; NaN where it has no estimate."""
        runs, *chunks = sums
        squares, filled = np.empty((len(runs), sum(map(np.size, chunks)) // max(1, len(runs)))), 0
        for chunk in chunks:
            of_runs = chunk.reshape(-1, len(runs)).T
            squares[:, filled : filled + of_runs.shape[1]] = of_runs
            filled += of_runs.shape[1]
        return percentile(SHARE, squares)

    def merge(self, blocks: Sequence[Array]) -> Array:
        return np.concatenate(blocks)

    def finish(self, sums: Array) -> Outcome:
        finite = np.isfinite(sums)
        if not finite.any():
            return self.no_value("there is no estimate of any object to score")
        return ratio(np.where(finite, sums, 0.0), finite.astype(float), at_least=self.at_least)


def percentile(share: float, squares: Array) -> Array:
    """Return ``(rows,)`` errors below which a share of each row lies, interpolated linearly between the two nearest.

    NaN where a row has none. Source: type 7 of Hyndman and Fan (1996), "Sample quantiles in statistical packages".

    Args:
        share: 0 to 1.
        squares: ``(rows, errors)`` of the errors, NaN where one does not count; they are changed.
    """
    rows, size = squares.shape
    if not size:
        return np.full(rows, np.nan)
    row, column = np.nonzero(np.isnan(squares))
    missing = np.bincount(row, minlength=rows)
    rank = share * np.maximum(size - missing - 1, 0)
    whole = np.floor(rank)
    place = int(share * (size - 1))
    # So many of those that do not count are put first, and the others last, that what is sought has one place in all
    # rows: NumPy finds a single place of contiguous rows many times faster than several.
    number = np.arange(len(row)) - np.searchsorted(row, row)
    squares[row, column] = np.where(number < (place - whole)[row], -1.0, np.inf)
    above = min(place + 1, size - 1)
    squares.partition(above, axis=1)
    low, high = squares[:, : place + 1].max(axis=1), squares[:, above]
    rest = rank - whole
    with np.errstate(invalid="ignore"):
        low, high = np.sqrt(low), np.sqrt(np.where(rest > 0.0, high, low))
        return np.where(missing < size, low + rest * (high - low), np.nan)


class PositionP95(ErrorPercentile):
    name, unit, row = "position_p95", "m", 0
    meaning = "error of the position that 95 % of the estimates of a run stay below, mean over runs"


class VelocityP95(ErrorPercentile):
    name, unit, row = "velocity_p95", "m/s", 1
    meaning = "error of the velocity that 95 % of the estimates of a run stay below, mean over runs"
