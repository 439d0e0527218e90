"""Which tracks are near which objects, and which count: computed once for all scores."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.traffic_metrics.histories import TrackHistory, TruthHistory
from trackbench.traffic_metrics.matching import best_matching
from trackbench.types import ABSENT, DUE, OPTIONAL, Array, Indices, Mask

#: Distances computed at once: they fit the cache.
CHUNK = 1 << 18


class NearPairs(NamedTuple):
    """Pairs ``(P,)`` of an object and a track that are within the cutoff at an instant, in the order of instants."""

    instant: Indices
    object: Indices
    column: Indices
    """Of the track, in the history."""
    track: Indices
    """Its number: one for each id."""
    distance: Array
    """m."""

    def where(self, mask: Mask) -> NearPairs:
        """Some of them."""
        return NearPairs(
            self.instant[mask], self.object[mask], self.column[mask], self.track[mask], self.distance[mask]
        )


def similarity(distance: Array, cutoff: float) -> Array:
    """From 1 at no distance to 0 at the cutoff, as HOTA, CLEAR and identity take it."""
    return 1 - distance / cutoff


class Counted(NamedTuple):
    """What counts in a run: the due objects, and the tracks that are on no optional one."""

    cutoff: float
    """m."""
    due: Mask
    """``(T, N)``."""
    present: Mask
    """``(T, K)``: the tracks that count."""
    excused: Mask
    """``(T, K)``: the tracks that are on an optional object."""
    track: Indices
    """``(T, K)`` the number of each track, -1 where a column is empty."""
    ids: Indices
    """``(tracks,)`` the id of each number."""
    pairs: NearPairs
    """Of those that count."""
    nearest: Mask
    """``(P,)`` the pairs that :func:`gospa` matches."""

    @property
    def object_counts(self) -> Indices:
        """``(N,)`` instants at which each object is due."""
        return np.asarray(self.due.sum(axis=0))

    @property
    def track_counts(self) -> Indices:
        """``(tracks,)`` instants at which each track counts."""
        return np.bincount(self.track[self.present], minlength=len(self.ids))


def count(truth: TruthHistory, tracks: TrackHistory, cutoff: float) -> Counted:
    """Match due and optional objects together, and leave out the tracks on optional ones.

    At each instant objects and tracks within ``cutoff`` m are matched one-to-one so that the sum of the squared
    distances, with ``cutoff`` squared for each object and track without partner halved between them, is smallest. A
    track whose partner is optional, or that has none and is within the cutoff of an optional object, does not count.

    Source: Milan et al. (2016), "MOT16: A benchmark for multi-object tracking", section 4 (matching first, then leaving
    out what is on objects that are not to be tracked).
    """
    ids, track = np.unique(tracks.ids, return_inverse=True)
    if len(ids) and ids[0] < 0:
        ids, track = ids[1:], track - 1
    track = track.reshape(tracks.ids.shape)
    present, exists = track >= 0, truth.status > ABSENT
    pairs = near_pairs(_where(truth.state[:2], exists), _where(tracks.mean[:2], present), track, cutoff)
    chosen = best_matching(
        pairs.instant,
        pairs.object,
        pairs.column,
        cutoff**2 - pairs.distance**2,
        truth.status.shape[1],
        tracks.ids.shape[1],
    )
    optional = (truth.status == OPTIONAL)[pairs.instant, pairs.object]
    excused = np.zeros_like(present)
    if optional.any():
        matched = np.zeros_like(present)
        matched[pairs.instant[chosen], pairs.column[chosen]] = True
        on = optional & (chosen | ~matched[pairs.instant, pairs.column])
        excused[pairs.instant[on], pairs.column[on]] = True
    kept = ~optional & ~excused[pairs.instant, pairs.column]
    return Counted(
        cutoff, truth.status == DUE, present & ~excused, excused, track, ids, pairs.where(kept), chosen[kept]
    )


def near_pairs(objects: Array, tracks: Array, track: Indices, cutoff: float) -> NearPairs:
    """The pairs within ``cutoff`` of positions ``(2, T, N)`` and ``(2, T, K)`` m, NaN where there is nothing."""
    steps, n, k = objects.shape[1], objects.shape[2], tracks.shape[2]
    at_once = max(1, CHUNK // max(1, n * k))
    found, squares = [np.empty(0, dtype=np.intp)], [np.empty(0)]
    for start in range(0, steps, at_once):
        part = slice(start, start + at_once)
        square = _squared(objects[0, part], tracks[0, part])
        square += _squared(objects[1, part], tracks[1, part])
        square = square.reshape(-1)
        near = np.flatnonzero(square <= cutoff**2)
        found.append(near + start * n * k)
        squares.append(square[near])
    cell, column = np.divmod(np.concatenate(found), max(1, k))
    instant, item = np.divmod(cell, max(1, n))
    return NearPairs(instant, item, column, track[instant, column], np.sqrt(np.concatenate(squares)))


def _squared(a: Array, b: Array) -> Array:
    difference = a[:, :, None] - b[:, None]
    return np.multiply(difference, difference, out=difference)


def _where(position: Array, there: Mask) -> Array:
    return np.where(there, position, np.nan)
