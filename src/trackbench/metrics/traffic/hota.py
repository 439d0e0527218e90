"""HOTA: detection and association in one number."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.metrics.traffic.assignment import NearPairs
from trackbench.metrics.traffic.matching import best_matching

#: The similarities from which a pair may count as matched; the scores are means over them.
THRESHOLDS = np.arange(0.05, 0.99, 0.05)
EPSILON = np.finfo(float).eps


class HotaScores(NamedTuple):
    """Each ``(19,)``, one value for each threshold."""

    hota: Array
    detection: Array
    """DetA."""
    association: Array
    """AssA."""


def hota(pairs: NearPairs, similarity: Array, object_counts: Indices, track_counts: Indices) -> HotaScores:
    """Higher order tracking accuracy.

    Source: Luiten et al. (2021), "HOTA: A higher order metric for evaluating multi-object tracking", International
    Journal of Computer Vision 129, with the matching of its public code: pairs that go together over the whole run are
    preferred.

    Args:
        pairs: ``(P,)`` at least all with a similarity above zero.
        similarity: ``(P,)`` from 0 to 1.
        object_counts: ``(N,)`` instants at which each object is there.
        track_counts: ``(tracks,)`` the same of the tracks.
    """
    objects, tracks = len(object_counts), len(track_counts)
    together = pairs.object * tracks + pairs.track
    jaccard = _jaccard(pairs, similarity, objects, tracks)
    potential = np.bincount(together, jaccard, minlength=objects * tracks)[together]
    all_counts = object_counts[pairs.object] + track_counts[pairs.track]
    alignment = potential / (all_counts - potential)
    chosen = best_matching(*pairs[:2], pairs.track, alignment * similarity, objects, tracks)
    passed = np.searchsorted(THRESHOLDS - EPSILON, similarity[chosen], side="right")
    couple, first, which = np.unique(together[chosen], return_index=True, return_inverse=True)
    levels = len(THRESHOLDS) + 1
    exact = np.bincount(which * levels + passed, minlength=len(couple) * levels).reshape(len(couple), levels)
    # (couples, 19) instants at which object and track are matched at each threshold.
    matches = np.cumsum(exact[:, ::-1], axis=1)[:, ::-1][:, 1:]
    union = all_counts[chosen][first][:, None] - matches
    true = matches.sum(axis=0)
    association = (matches * (matches / np.maximum(1, union))).sum(axis=0) / np.maximum(1, true)
    detection = true / np.maximum(1, object_counts.sum() + track_counts.sum() - true)
    return HotaScores(np.sqrt(detection * association), detection, association)


def _jaccard(pairs: NearPairs, similarity: Array, objects: int, tracks: int) -> Array:
    """``(P,)`` the similarity of each pair as a share of what object and track have with all."""
    by_object, by_track = pairs.instant * objects + pairs.object, pairs.instant * tracks + pairs.track
    whole = np.bincount(by_object, similarity)[by_object] + np.bincount(by_track, similarity)[by_track] - similarity
    return np.asarray(np.divide(similarity, whole, out=np.zeros_like(similarity), where=whole > EPSILON))
