"""A whole track smoothed by a filter."""

from collections.abc import Sequence

from trackbench.filters.base import B, Filter


def smoothed(filter: Filter[B], filtered: Sequence[B], intervals: Sequence[float]) -> list[B]:
    """A filter's beliefs given all measurements, from the last to the first.

    Args:
        filter: the one that gave the beliefs.
        filtered: ``(T,)`` after the update of each instant; those with batch axes are smoothed together.
        intervals: ``(T - 1,)`` from each instant to the next, s.
    """
    result = [filtered[-1]]
    for belief, dt in zip(reversed(filtered[:-1]), reversed(intervals), strict=True):
        result.append(filter.smooth(belief, result[-1], dt))
    return result[::-1]
