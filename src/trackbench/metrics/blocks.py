"""Confidence intervals from a single log by a block bootstrap, since neighbouring residuals are not independent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from trackbench.base.types import Array, Indices

#: Largest and smallest number of time blocks that a log is cut into.
MOST, FEWEST = 40, 8
#: Least length of a time block, as a multiple of the correlation time of the residuals.
LONGER = 5.0
#: Number of objects from which on the rows of each object are drawn as a block too.
OBJECTS = 8
DRAWS = 400
SEED = 20261


class BlockInterval(NamedTuple):
    """Estimate of a statistic from one log, with its standard deviation by a block bootstrap."""

    value: float
    sigma: float
    freedom: float
    """Degrees of freedom of the standard deviation ``sigma``, for Student's t."""

    def bounds(self, level: float = 0.95) -> tuple[float, float]:
        """Return the interval that holds the true value with probability ``level``."""
        reach = stdtrit(self.freedom, 0.5 + level / 2) * self.sigma
        return self.value - reach, self.value + reach

    def excludes(self, value: float, level: float) -> bool:
        """Return whether ``value`` lies outside the interval of this level."""
        low, high = self.bounds(level)
        return not low <= value <= high


@dataclass(frozen=True)
class Blocks:
    """Cuts of a log's rows into blocks: by time and, with many objects, also by object. The wider interval is taken."""

    cuts: tuple[Indices, ...]
    """For each way to cut, by time and by object, ``(rows,)`` the number of the block of each row."""

    def intervals(self, terms: Array, finish: Callable[[Array], Array]) -> list[BlockInterval]:
        """Return bootstrap intervals, from whole blocks, of statistics that are functions of sums over rows.

        For each statistic the cut with the widest interval is taken. Source: Kuensch (1989), "The jackknife and the
        bootstrap for general stationary observations"; the t quantile for few blocks as in Cameron, Gelbach and Miller
        (2008), "Bootstrap-based improvements for inference with clustered errors".

        Args:
            terms: ``(k, rows)`` term of each row in each of k sums.
            finish: computes the statistics ``(q, ...)`` from sums ``(k, ...)``.
        """
        value = finish(terms.sum(axis=1))
        spreads: list[tuple[Array, int]] = []
        for cut in self.cuts:
            count = int(cut.max()) + 1 if len(cut) else 0
            if count < 2:
                continue
            sums = np.stack([np.bincount(cut, row, count) for row in terms])
            weights = np.random.default_rng(SEED).multinomial(count, np.full(count, 1 / count), DRAWS)
            drawn = finish(np.asarray(sums @ weights.T, dtype=np.float64))
            drawn = np.where(np.isfinite(drawn), drawn, np.nan)
            has_spread = np.isfinite(drawn).sum(axis=1) > 1
            spread = np.full(len(drawn), np.nan)
            spread[has_spread] = np.nanstd(drawn[has_spread], axis=1, ddof=1)
            spreads.append((spread * np.sqrt(count / (count - 1)), count - 1))
        result = []
        for i, statistic in enumerate(value.tolist()):
            finite = [(float(sigma[i]), freedom) for sigma, freedom in spreads if np.isfinite(sigma[i])]
            widest = max(finite, key=lambda spread: spread[0] * stdtrit(spread[1], 0.975), default=(np.inf, 1))
            result.append(BlockInterval(statistic, *widest))
        return result


def blocks_of(time: Array, owner: Indices, residual: Array) -> Blocks:
    """Cut rows into blocks that are longer than the measured correlation time of their residuals.

    Args:
        time: ``(rows,)`` time of each row, s, sorted.
        owner: ``(rows,)`` object number of each row.
        residual: ``(m, rows)`` m components of each row's residual.
    """
    span = max(float(time[-1] - time[0]), 1e-9)
    correlated = max(correlation_time(time, owner, row) for row in residual)
    count = int(np.clip(span / max(LONGER * correlated, 1e-9), FEWEST, MOST))
    count = max(2, min(count, len(time) // 3))
    # Blocks with the same number of rows, so that none is empty where the log has gaps.
    by_time = np.minimum(np.arange(len(time)) * count // len(time), count - 1)
    # Rows of one instant stay together.
    first = np.searchsorted(time, time, side="left")
    by_time = np.unique(by_time[first], return_inverse=True)[1].astype(np.intp)
    objects = np.unique(owner, return_inverse=True)[1].astype(np.intp)
    draws_objects = len(objects) and objects.max() + 1 >= OBJECTS
    return Blocks((by_time, objects) if draws_objects else (by_time,))


def correlation_time(time: Array, owner: Indices, residual: Array) -> float:
    """Return the time, s, after which residuals of one object are no longer correlated beyond noise."""
    products: dict[int, list[float]] = {}
    spacing = []
    scale = float(np.mean(residual**2))
    if scale <= 0:
        return 0.0
    for number in np.unique(owner):
        centred = residual[owner == number] - residual[owner == number].mean()
        if len(centred) < FEWEST:
            continue
        spacing.append(float(np.median(np.diff(time[owner == number]))))
        for lag in range(1, min(200, len(centred) // 4) + 1):
            products.setdefault(lag, []).append(float(centred[:-lag] @ centred[lag:]) / (len(centred) - lag))
    total = 0.5
    for lag in sorted(products):
        correlation = float(np.mean(products[lag])) / scale
        # Twice the noise of an autocorrelation of white residuals.
        if correlation < 2 / np.sqrt(len(residual)):
            break
        total += correlation
    return float(np.median(spacing)) * (2 * total - 1) if spacing else 0.0
