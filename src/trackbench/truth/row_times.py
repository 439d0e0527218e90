"""Period of the rows of a track, and gaps where rows are missing."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Indices, Mask

#: Longest step without a missing row, in periods; time stamps may jitter by up to a quarter of a period.
WHOLE = 1.5
#: Share of the steps that is at most one period long, even if most rows are missing.
SHORT = 0.1
ROUNDS = 10


def row_period(stamp: Array) -> tuple[float, Mask]:
    """Return the usual time between rows of one body, and which neighbouring rows have no gap between them.

    The period is the median of the time steps without a gap, found iteratively from the shortest steps.

    Args:
        stamp: ``(rows,)`` time stamps, s, ascending.

    Returns:
        Period, s, 0 for a single row; and a mask ``(rows - 1,)``, True where no row is missing.
    """
    steps = np.diff(stamp)
    if not len(steps):
        return 0.0, np.zeros(0, dtype=bool)
    period = float(np.quantile(steps, SHORT, method="lower"))
    for _ in range(ROUNDS):
        period = float(np.median(steps[steps <= WHOLE * period]))
    return period, np.asarray(steps <= WHOLE * period)


def nearest_rows(stamp: Array, time: Array) -> tuple[Indices, Array, Indices]:
    """Return, for each time, the nearest row (in a tie the earlier), its distance, s, and the last row before the time.

    Rows are indices. The last row before the time is limited to 0 ... rows - 2, also for times outside all rows.

    Args:
        stamp: ``(rows,)`` time stamps, s, ascending.
        time: ``(times,)`` times to look up, s.
    """
    after = np.clip(np.searchsorted(stamp, time), 0, len(stamp) - 1)
    before = np.maximum(after - 1, 0)
    distance = np.abs(stamp[[before, after]] - time)
    return np.where(distance[0] <= distance[1], before, after), distance.min(axis=0), before
