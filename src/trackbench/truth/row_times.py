"""The period of the rows of a track, and where rows are missing."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Indices, Mask

#: A longer gap, in periods, lacks a row: so none is misjudged while stamps jitter by up to a quarter of a period.
WHOLE = 1.5
#: Share of the steps that are not longer than one period, even where most rows are missing.
SHORT = 0.1
ROUNDS = 10


def row_period(stamp: Array) -> tuple[float, Mask]:
    """Return the period of the rows of one body, and which gaps between them lack no row.

    The period is the median of the steps that lack no row, from the shortest steps on.

    Args:
        stamp: ``(rows,)`` s, ascending.

    Returns:
        The period, s, 0 of a single row, and a mask ``(rows - 1,)``.
    """
    steps = np.diff(stamp)
    if not len(steps):
        return 0.0, np.zeros(0, dtype=bool)
    period = float(np.quantile(steps, SHORT, method="lower"))
    for _ in range(ROUNDS):
        period = float(np.median(steps[steps <= WHOLE * period]))
    return period, np.asarray(steps <= WHOLE * period)


def nearest_rows(stamp: Array, time: Array) -> tuple[Indices, Array, Indices]:
    """Return for each time the nearest row, the earlier of two as near, how far it is, s, and the row before.

    Args:
        stamp: ``(rows,)`` s, ascending.
        time: ``(times,)`` s.
    """
    after = np.clip(np.searchsorted(stamp, time), 0, len(stamp) - 1)
    before = np.maximum(after - 1, 0)
    away = np.abs(stamp[[before, after]] - time)
    return np.where(away[0] <= away[1], before, after), away.min(axis=0), before
