"""Intervals from blocks of a single log: what is near in time, or of one object, is not independent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from trackbench.base.types import Array, Indices

#: Blocks of time that a log is cut into, at most and at least.
MOST, FEWEST = 40, 8
#: Blocks are this many times longer than the residuals are correlated.
LONGER = 5.0
#: Objects from which on whole objects are drawn too.
OBJECTS = 8
DRAWS = 400
SEED = 20261


class BlockInterval(NamedTuple):
    """An estimate with its uncertainty."""

    value: float
    sigma: float
    """Standard deviation of the estimate."""
    freedom: float
    """Degrees of freedom of the standard deviation."""

    def bounds(self, level: float = 0.95) -> tuple[float, float]:
        """The interval that holds the true value with this probability."""
        reach = stdtrit(self.freedom, 0.5 + level / 2) * self.sigma
        return self.value - reach, self.value + reach

    def excludes(self, value: float, level: float) -> bool:
        """Whether ``value`` is outside the interval."""
        low, high = self.bounds(level)
        return not low <= value <= high


@dataclass(frozen=True)
class Blocks:
    """Two ways to cut the rows of a log: by time, and by object."""

    cuts: tuple[Indices, ...]
    """Each ``(rows,)`` the number of the block of each row."""

    def intervals(self, terms: Array, finish: Callable[[Array], Array]) -> list[BlockInterval]:
        """Intervals of statistics that are functions of sums over rows, by a bootstrap that draws whole blocks.

        Of the two ways to cut, the one with the wider interval counts. Source: Kuensch (1989), "The jackknife and the
        bootstrap for general stationary observations"; the t quantile for few blocks as in Cameron, Gelbach and Miller
        (2008), "Bootstrap-based improvements for inference with clustered errors".

        Args:
            terms: ``(k, rows)`` what is summed.
            finish: from sums ``(k, ...)`` to the statistics ``(q, ...)``.
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
            several = np.isfinite(drawn).sum(axis=1) > 1
            spread = np.full(len(drawn), np.nan)
            spread[several] = np.nanstd(drawn[several], axis=1, ddof=1)
            spreads.append((spread * np.sqrt(count / (count - 1)), count - 1))
        result = []
        for i, of in enumerate(value.tolist()):
            finite = [(float(sigma[i]), freedom) for sigma, freedom in spreads if np.isfinite(sigma[i])]
            wide = max(finite, key=lambda spread: spread[0] * stdtrit(spread[1], 0.975), default=(np.inf, 1))
            result.append(BlockInterval(of, *wide))
        return result


def blocks_of(time: Array, owner: Indices, residual: Array) -> Blocks:
    """Blocks for rows whose residuals are correlated over a time that is measured.

    Args:
        time: ``(rows,)`` s, sorted.
        owner: ``(rows,)`` number of the object.
        residual: ``(m, rows)``.
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
    several = len(objects) and objects.max() + 1 >= OBJECTS
    return Blocks((by_time, objects) if several else (by_time,))


def correlation_time(time: Array, owner: Indices, residual: Array) -> float:
    """For how long the residuals of one object stay alike, s: until their autocorrelation is below its noise."""
    products: dict[int, list[float]] = {}
    spacing = []
    scale = float(np.mean(residual**2))
    if scale <= 0:
        return 0.0
    for number in np.unique(owner):
        own = residual[owner == number] - residual[owner == number].mean()
        if len(own) < FEWEST:
            continue
        spacing.append(float(np.median(np.diff(time[owner == number]))))
        for lag in range(1, min(200, len(own) // 4) + 1):
            products.setdefault(lag, []).append(float(own[:-lag] @ own[lag:]) / (len(own) - lag))
    total = 0.5
    for lag in sorted(products):
        correlation = float(np.mean(products[lag])) / scale
        # Twice the noise of an autocorrelation of white residuals.
        if correlation < 2 / np.sqrt(len(residual)):
            break
        total += correlation
    return float(np.median(spacing)) * (2 * total - 1) if spacing else 0.0
