"""One-to-one matching of largest total gain within each of many small groups."""

from __future__ import annotations

import numpy as np

from trackbench.base.scipy_functions import largest_assignment
from trackbench.base.types import Array, Indices, Mask

#: Passes that settle what is plain before the rest is solved group by group.
PASSES = 3


def best_matching(group: Indices, row: Indices, column: Indices, gain: Array, rows: int, columns: int) -> Mask:
    """``(P,)`` which of the pairs are matched, so that the gain of each group is largest.

    A pair that gains more than the best other pairs of its row and of its column together is part of every optimum:
    such pairs are settled for all groups at once, and few groups remain for the assignment algorithm.

    Args:
        group: ``(P,)`` in increasing order.
        row: ``(P,)`` below ``rows``.
        column: ``(P,)`` below ``columns``; a row and a column meet at most once in a group.
        gain: ``(P,)``; pairs that gain nothing are not matched.
    """
    chosen = np.zeros(len(group), dtype=bool)
    left = np.flatnonzero(gain > 0)
    in_row, in_column = group * rows + row, group * columns + column
    for _ in range(PASSES):
        if not len(left):
            return chosen
        cells, gains = (in_row[left], in_column[left]), gain[left]
        settled = gains > _best_other(cells[0], gains) + _best_other(cells[1], gains)
        chosen[left[settled]] = True
        left = left[~(among(cells[0], cells[0][settled]) | among(cells[1], cells[1][settled]))]
    for part in parts_of(group[left]):
        own = left[part]
        chosen[own[matched_in_group(row[own], column[own], gain[own])]] = True
    return chosen


def parts_of(group: Indices) -> list[slice]:
    """The stretches of equal numbers."""
    if not len(group):
        return []
    ends = [*(np.flatnonzero(group[1:] != group[:-1]) + 1).tolist(), len(group)]
    return [slice(start, end) for start, end in zip([0, *ends[:-1]], ends, strict=True)]


def matched_in_group(row: Indices, column: Indices, gain: Array) -> Mask:
    """``(P,)`` which pairs of one group, with gains above zero, are matched."""
    rows, i = np.unique(row, return_inverse=True)
    columns, j = np.unique(column, return_inverse=True)
    matrix = np.zeros((len(rows), len(columns)))
    matrix[i, j] = gain
    partner = np.full(len(rows), -1)
    first, second = largest_assignment(matrix)
    partner[first] = second
    return np.asarray(partner[i] == j)


def _best_other(cell: Indices, gain: Array) -> Array:
    """``(P,)`` the largest gain among the other pairs of the same cell; 0 where there is none."""
    best = np.zeros(cell.max() + 1)
    np.maximum.at(best, cell, gain)
    is_best = gain == best[cell]
    second = np.zeros_like(best)
    np.maximum.at(second, cell[~is_best], gain[~is_best])
    alone = np.bincount(cell[is_best], minlength=len(best)) == 1
    return np.where(is_best & alone[cell], second[cell], best[cell])


def among(values: Indices, some: Indices) -> Mask:
    """Which of the values, 0 or more, are among some of them."""
    mark = np.zeros(values.max() + 1, dtype=bool)
    mark[some] = True
    return mark[values]
