"""GOSPA and OSPA of sets of positions, and OSPA(2) of sets of trajectories."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.traffic.assignment import Counted, best_matching, near_pairs


class GospaParts(NamedTuple):
    """The parts of GOSPA to the power p, ``(T,)`` each; the metric is the p-th root of their sum."""

    localisation: Array
    """Distances of matched pairs."""
    missed: Array
    """``c^p / 2`` for each object without a track."""
    false: Array
    """``c^p / 2`` for each track without an object."""

    @property
    def total(self) -> Array:
        """``(T,)``."""
        return self.localisation + self.missed + self.false


def gospa(counted: Counted) -> GospaParts:
    """Generalised optimal sub-pattern assignment metric with alpha = 2 and p = 2.

    Of the best matching, the squared distances of the pairs plus c^2 / 2 for each object and each track that is in
    none; the metric is the root.

    Source: Rahmathullah, Garcia-Fernandez and Svensson (2017), "Generalized optimal sub-pattern assignment metric",
    definition 1 and proposition 1.
    """
    matched = counted.matched
    return _parts(
        matched.instant, matched.distance, counted.due.sum(axis=1), counted.present.sum(axis=1), counted.cutoff, 2.0
    )


def gospa_of_sets(objects: Array, tracks: Array, cutoff: float, p: float = 2.0) -> GospaParts:
    """The same of positions ``(2, T, N)`` and ``(2, T, K)`` m, NaN where there is nothing, for any exponent."""
    numbers = np.broadcast_to(np.arange(tracks.shape[2]), tracks.shape[1:])
    pairs = near_pairs(objects, tracks, numbers, cutoff)
    chosen = best_matching(*pairs[:3], cutoff**p - pairs.distance**p, objects.shape[2], tracks.shape[2])
    matched = pairs.where(chosen)
    there = [np.isfinite(positions[0]).sum(axis=1) for positions in (objects, tracks)]
    return _parts(matched.instant, matched.distance, there[0], there[1], cutoff, p)


def _parts(instant: Indices, distance: Array, objects: Indices, tracks: Indices, cutoff: float, p: float) -> GospaParts:
    steps = len(objects)
    pairs = np.bincount(instant, minlength=steps)
    half = cutoff**p / 2
    localisation = np.bincount(instant, distance**p, minlength=steps)
    return GospaParts(np.asarray(localisation, dtype=float), half * (objects - pairs), half * (tracks - pairs))


def ospa(parts: GospaParts, objects: Indices, tracks: Indices) -> Array:
    """Optimal sub-pattern assignment metric to the power p.

    It has the matching of GOSPA, and n is the larger number of objects and tracks. The distances of matched pairs to
    the power p, plus c^p for each of the n that is not matched, are summed and divided by n; 0 where there is nothing.

    Source: Schuhmacher, Vo and Vo (2008), "A consistent metric for performance evaluation of multi-object filters".

    Args:
        parts: of GOSPA, to the power p.
        objects: ``(T,)`` their numbers.
        tracks: ``(T,)`` the same.

    Returns:
        ``(T,)``, m^2 with the parts of :func:`gospa`.
    """
    unmatched = 2.0 * np.where(tracks > objects, parts.false, parts.missed)
    return np.asarray((parts.localisation + unmatched) / np.maximum(np.maximum(objects, tracks), 1))


def ospa2(counted: Counted, window: int) -> Array:
    """OSPA(2) of order 2, in windows of time one after another.

    The distance of an object and a track in a window is the mean, over the instants at which at least one of them is
    there, of the distance between them, cut off at c; c where only one is. OSPA of order 2 takes it from there. An
    incomplete last window counts as one.

    Source: Beard, Vo and Vo (2020), "A solution for large-scale multi-object tracking", section III (one window, equal
    weights).

    Returns:
        ``(windows,)`` its squares, m^2, of ``window`` instants each.
    """
    steps, objects = counted.due.shape
    starts = np.arange(0, steps, window)
    tracks = len(counted.ids)
    there = np.zeros((steps, tracks), dtype=bool)
    instant, column = np.nonzero(counted.present)
    there[instant, counted.track[instant, column]] = True
    in_window = [np.add.reduceat(mask.astype(np.intp), starts, axis=0) for mask in (counted.due, there)]
    both = _both(counted.due, there, window)
    union = in_window[0][:, :, None] + in_window[1][:, None] - both
    pairs = counted.pairs
    cell = (pairs.instant // window * objects + pairs.object) * tracks + pairs.track
    saved = np.bincount(cell, counted.cutoff - pairs.distance, minlength=union.size).reshape(union.shape)
    group, row, col = np.nonzero(saved)
    distance = counted.cutoff - saved[group, row, col] / union[group, row, col]
    chosen = best_matching(group, row, col, counted.cutoff**2 - distance**2, objects, tracks)
    total = np.bincount(group[chosen], distance[chosen] ** 2, minlength=len(starts))
    matched = np.bincount(group[chosen], minlength=len(starts))
    most = np.maximum(*((counts > 0).sum(axis=1) for counts in in_window))
    return np.asarray((total + counted.cutoff**2 * (most - matched)) / np.maximum(most, 1))


def _both(due: Mask, there: Mask, window: int) -> Array:
    """``(windows, N, tracks)`` instants of each window at which both are there."""
    windows = -(-len(due) // window)
    filled = ((0, windows * window - len(due)), (0, 0))
    cut = [np.pad(mask, filled).reshape(windows, window, mask.shape[1]).astype(float) for mask in (due, there)]
    return np.asarray(np.swapaxes(cut[0], 1, 2) @ cut[1])
