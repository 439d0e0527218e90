"""Public scores of multi-object tracking: CLEAR, HOTA and IDF1."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.traffic.assignment import (
    NearPairs,
    among,
    best_matching,
    equal_stretches,
    last_instant_before,
)
from trackbench.trackers.multi.association import assigned

NO_TRACK = NOBODY = -1


class Switches(NamedTuple):
    """Identity switches ``(switches,)``, ordered by object: an object has another track than before."""

    instant: Indices
    object: Indices
    before: Indices
    after: Indices
    """Number of the object's track after each switch; ``before`` holds the track before the switch."""


def clear_matches(pairs: NearPairs, gain: Array, objects: Mask, tracks: Mask) -> Mask:
    """Match objects and tracks at each instant: first pairs matched at earlier instants, then the nearest pairs.

    With misses FN, false tracks FP and switches IDSW, MOTA = 1 - (FN + FP + IDSW) / due instants. Source: Bernardin and
    Stiefelhagen (2008), "Evaluating multiple object tracking performance: the CLEAR MOT metrics", section 2.1.1. An
    instant without objects or without tracks is passed over, as in TrackEval.

    Args:
        pairs: all pairs that are near enough to be matched.
        gain: ``(P,)`` above zero, larger for a nearer pair.
        objects: ``(T, N)`` where an object is there.
        tracks: ``(T, K)`` where a column has a track.

    Returns:
        ``(P,)`` mask of the pairs that are matched.
    """
    rows, columns = objects.shape[1], tracks.shape[1]
    at_object, at_column = pairs.instant * rows + pairs.object, pairs.instant * columns + pairs.column
    is_uncontested = (np.bincount(at_object)[at_object] == 1) & (np.bincount(at_column)[at_column] == 1)
    matched: Mask = is_uncontested.copy()
    track_of = np.full(objects.shape, NO_TRACK)
    track_of[pairs.instant[is_uncontested], pairs.object[is_uncontested]] = pairs.track[is_uncontested]
    before = last_instant_before(np.asarray(objects.any(axis=1) & tracks.any(axis=1)))
    contested = np.flatnonzero(~is_uncontested)
    for part in equal_stretches(pairs.instant[contested]):
        group = contested[part]
        instant, item, track = pairs.instant[group[0]], pairs.object[group], pairs.track[group]
        stays = track_of[before[instant], item] == track if before[instant] >= 0 else np.zeros(len(group), dtype=bool)
        left = group[~(among(item, item[stays]) | among(pairs.column[group], pairs.column[group[stays]]))]
        now = group[stays]
        if len(left):
            won = left[assigned(pairs.object[left], pairs.column[left], gain[left])]
            now = np.concatenate([now, won])
        matched[now] = True
        track_of[instant, pairs.object[now]] = pairs.track[now]
    return np.asarray(matched)


def object_of_each(matched: NearPairs, steps: int, tracks: int) -> Indices:
    """Return the number of the object that each track is matched with, ``(T, tracks)``; ``NOBODY`` for none."""
    object_of = np.full((steps, tracks), NOBODY)
    object_of[matched.instant, matched.track] = matched.object
    return object_of


def track_of_each(matched: NearPairs, shape: tuple[int, ...]) -> Indices:
    """Return the number of the track that each object is matched with, ``(T, N)``; ``NO_TRACK`` for none."""
    track_of = np.full(shape, NO_TRACK)
    track_of[matched.instant, matched.object] = matched.track
    return track_of


def switches(track_of: Indices) -> Switches:
    """Return every change of an object's track, however long the object had no track in between, as in CLEAR."""
    item, instant = np.nonzero(track_of.T != NO_TRACK)
    track = track_of[instant, item]
    changed = np.flatnonzero((item[1:] == item[:-1]) & (track[1:] != track[:-1])) + 1
    return Switches(instant[changed], item[changed], track[changed - 1], track[changed])


#: Similarities from which on a pair may count as matched; HOTA and its parts are means over them.
THRESHOLDS = np.arange(0.05, 0.99, 0.05)
EPSILON = np.finfo(float).eps


class HotaScores(NamedTuple):
    """HOTA and its two factors, each ``(19,)``: one value for each threshold of the similarity."""

    hota: Array
    detection: Array
    """``(19,)`` detection accuracy DetA at each threshold."""
    association: Array
    """``(19,)`` association accuracy AssA at each threshold."""


def hota(pairs: NearPairs, similarity: Array, object_counts: Indices, track_counts: Indices) -> HotaScores:
    """Return the higher order tracking accuracy ``sqrt(DetA AssA)`` at each threshold of the similarity.

    DetA = TP / (TP + FN + FP), and AssA is the mean over matched pairs of TPA / (TPA + FNA + FPA). Source: Luiten et
    al. (2021), "HOTA: A higher order metric for evaluating multi-object tracking", International Journal of Computer
    Vision 129, with the matching of its public code: pairs of an object and a track that are near each other for much
    of the run are preferred.

    Args:
        pairs: P pairs of an object and a track at an instant, at least all with a similarity above zero.
        similarity: ``(P,)`` similarity of each pair, from 0 to 1.
        object_counts: ``(N,)`` number of instants at which each object is there.
        track_counts: ``(tracks,)`` number of instants at which each track is there.
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
    """Return the similarity ``(P,)`` of each pair as a share of all similarities of its object and its track."""
    by_object, by_track = pairs.instant * objects + pairs.object, pairs.instant * tracks + pairs.track
    whole = np.bincount(by_object, similarity)[by_object] + np.bincount(by_track, similarity)[by_track] - similarity
    return np.asarray(np.divide(similarity, whole, out=np.zeros_like(similarity), where=whole > EPSILON))


def identity(pairs: NearPairs, object_counts: Indices, track_counts: Indices) -> tuple[int, int, int]:
    """Match objects and tracks one-to-one for the whole run, so that they are together at most instants, for IDF1.

    IDF1 = 2 IDTP / (2 IDTP + IDFP + IDFN). Source: Ristani et al. (2016), "Performance measures and a data set for
    multi-target, multi-camera tracking".

    Args:
        pairs: all pairs that are near enough to be matched.
        object_counts: ``(N,)`` instants at which each object is there.
        track_counts: ``(tracks,)`` instants at which each track is there.

    Returns:
        IDTP, instants at which an object is together with its matched track; IDFN, other instants of objects; IDFP,
        other instants of tracks.
    """
    # A run with known identities does without the .3 s of this import.
    from scipy.optimize import linear_sum_assignment

    objects, tracks = len(object_counts), len(track_counts)
    together = np.bincount(pairs.object * tracks + pairs.track, minlength=objects * tracks)
    table = together.reshape(objects, tracks).astype(float)
    true = int(table[linear_sum_assignment(table, maximize=True)].sum())
    return true, int(object_counts.sum()) - true, int(track_counts.sum()) - true
