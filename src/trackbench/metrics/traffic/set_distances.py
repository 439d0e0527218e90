"""GOSPA of sets of positions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices
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
