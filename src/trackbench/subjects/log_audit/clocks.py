"""The times in a log: their order, repetitions and gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackbench.base.types import Array
from trackbench.truth.recorded.drive import RowOrder

#: A gap is longer than this many usual intervals.
GAP = 5.0


@dataclass(frozen=True)
class Clock:
    """The times of one sensor's rows, or of the truth's."""

    name: str
    order: RowOrder
    outside: int
    """Rows outside the time of the truth."""
    usual_s: float | None
    """Median interval between different times."""
    gaps: int
    longest_gap_s: float
    longest_gap_at_s: float
    time: Array
    """All different times, sorted, s."""


def clock_of(name: str, time: Array, order: RowOrder, outside: int = 0) -> Clock:
    """What there is to say of some times.

    Args:
        name: of the sensor, or "truth".
        time: ``(rows,)`` s.
        order: in which the rows stand in the file.
        outside: rows outside the time of the truth.
    """
    different = np.unique(time)
    intervals = np.diff(different)
    if not len(intervals):
        return Clock(name, order, outside, None, 0, 0.0, 0.0, different)
    usual, longest = float(np.median(intervals)), int(np.argmax(intervals))
    gaps = int((intervals > GAP * usual).sum())
    return Clock(name, order, outside, usual, gaps, float(intervals[longest]), float(different[longest]), different)
