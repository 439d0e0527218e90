"""GOSPA of sets of positions, for any exponent, by the matching of the package."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array
from trackbench.metrics.traffic.assignment import best_matching, near_pairs
from trackbench.metrics.traffic.set_distances import GospaParts, parts_of_matching


def gospa_of_sets(objects: Array, tracks: Array, cutoff: float, p: float = 2.0) -> GospaParts:
    """The parts of positions ``(2, T, N)`` and ``(2, T, K)`` m, NaN where there is nothing."""
    numbers = np.broadcast_to(np.arange(tracks.shape[2]), tracks.shape[1:])
    pairs = near_pairs(objects, tracks, numbers, cutoff)
    chosen = best_matching(*pairs[:3], cutoff**p - pairs.distance**p, objects.shape[2], tracks.shape[2])
    matched = pairs.where(chosen)
    there = [np.isfinite(positions[0]).sum(axis=1) for positions in (objects, tracks)]
    return parts_of_matching(matched.instant, matched.distance, there[0], there[1], cutoff, p)
