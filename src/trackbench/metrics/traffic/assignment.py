"""Objects and tracks of a run, pairs of object and track that are near each other, and the tracks that are scored."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import ABSENT, DUE, Array, Indices, Mask
from trackbench.trackers.multi.association import best_assignment

#: Stands for the origin of a detection where a track took none.
NO_DETECTION = -2

Status = npt.NDArray[np.int8]


class TrafficScoreOptions(NamedTuple):
    """Criteria by which tracks are scored: cutoff distance, and cost of an identity switch."""

    cutoff: float = 5.0
    """Cutoff distance of GOSPA, m. At this distance the similarity of HOTA is 0; a track within half the cutoff
    distance is on the object."""
    switch_costs: float = 0.5
    """Time of missing an object that costs as much in T-GOSPA as an identity switch, s."""

    def switch(self, spacing: float) -> float:
        """Return the cost of an identity switch, m, where the instants are ``spacing`` s apart."""
        return self.cutoff * float(np.sqrt(self.switch_costs / spacing / 2)) if spacing else 0.0


class TruthHistory(NamedTuple):
    """True states of N objects at T instants, and whether each object must be tracked."""

    time: Array
    """``(T,)`` time of each instant, s, increasing."""
    state: Array
    """``(4, T, N)`` true px, py, vx, vy in the fixed frame."""
    status: Status
    """``(T, N)``: ``ABSENT``, ``OPTIONAL`` (a track on the object is neither right nor wrong) or ``DUE``."""
    at_tracks: Array | None = None
    """``(4, T, N, K)`` true states at the time stamp of each track; None if all tracks of an instant have the same time
    stamp."""

    def within(self, span: slice) -> TruthHistory:
        """Return the objects at the instants that the slice ``span`` selects."""
        at_tracks = None if self.at_tracks is None else self.at_tracks[:, span]
        return TruthHistory(self.time[span], self.state[:, span], self.status[span], at_tracks)

    def at(self, instant: Indices, item: Indices, column: Indices) -> Array:
        """Return true states ``(4, P)`` of P objects at P instants, each at the time stamp of the track in a column."""
        if self.at_tracks is not None:
            return self.at_tracks[:, instant, item, column]
        return self.state[:, instant, item]


class TrackHistory(NamedTuple):
    """Tracks that a tracker gave at T instants. The K columns have no meaning: a track can change its column."""

    ids: Indices
    """``(T, K)`` id of the track in each column, -1 where a column is empty."""
    mean: Array
    """``(4, T, K)`` estimated px, py, vx, vy of each track."""
    covariance: Array
    """``(4, 4, T, K)`` stated covariance of each track."""
    existence: Array | None = None
    """``(T, K)`` existence probability of each track; None where the tracker gives none."""

    def within(self, span: slice) -> TrackHistory:
        """Return the tracks at the instants that the slice ``span`` selects."""
        existence = None if self.existence is None else self.existence[span]
        return TrackHistory(self.ids[span], self.mean[:, span], self.covariance[:, :, span], existence)


class Associations(NamedTuple):
    """Detection that each track took in each of S scans, and the object that caused it."""

    instant: Indices
    """``(S,)`` index of the instant of each scan, in increasing order."""
    ids: Indices
    """``(S, K)`` ids of the tracks after the scan, -1 where a column is empty."""
    origin: Indices
    """``(S, K)`` index of the object that caused the detection of each track, ``FALSE_ALARM``, or ``NO_DETECTION``
    where the track took none."""
    detected: Mask
    """``(S, N)`` whether each object caused a detection in each scan."""
    merged: Indices | None = None
    """``(S, K)`` index of the second object of a track's detection that two objects caused, else negative; None if no
    detections are merged."""

    def within(self, span: slice) -> Associations:
        """Return the scans at the instants of the slice ``span``; the first instant of ``span`` becomes 0."""
        scans = slice(*np.searchsorted(self.instant, [span.start, span.stop]))
        merged = None if self.merged is None else self.merged[scans]
        return Associations(
            self.instant[scans] - span.start, self.ids[scans], self.origin[scans], self.detected[scans], merged
        )


def best_matching(group: Indices, row: Indices, column: Indices, gain: Array, rows: int, columns: int) -> Mask:
    """Return the mask ``(P,)`` of the pairs in the one-to-one matching with the largest gain in each group.

    Args:
        group: ``(P,)`` group of each pair.
        row: ``(P,)`` row of each pair.
        column: ``(P,)`` column of each pair; a row and a column meet at most once in a group.
        gain: ``(P,)`` gain of each pair; pairs that gain nothing are not matched.
        rows: number of rows.
        columns: number of columns.
    """
    chosen = np.zeros(len(group), dtype=bool)
    chosen[best_assignment(group * rows + row, group * columns + column, gain, group)] = True
    return chosen


def equal_stretches(group: Indices) -> list[slice]:
    """Return a slice for each stretch of equal neighbouring values of ``group``."""
    if not len(group):
        return []
    ends = [*(np.flatnonzero(group[1:] != group[:-1]) + 1).tolist(), len(group)]
    return [slice(start, end) for start, end in zip([0, *ends[:-1]], ends, strict=True)]


def among(values: Indices, chosen: Indices) -> Mask:
    """Return a mask of the ``values`` that occur in ``chosen``; all values must be 0 or more."""
    mark = np.zeros(values.max() + 1, dtype=bool)
    mark[chosen] = True
    return mark[values]


def last_instant(mask: Mask) -> Indices:
    """Return the index of the latest True in ``mask`` at or before each instant, ``(T, ...)``; -1 for none."""
    steps = np.arange(len(mask)).reshape(-1, *[1] * (mask.ndim - 1))
    return np.asarray(np.maximum.accumulate(np.where(mask, steps, -1), axis=0))


def last_instant_before(mask: Mask) -> Indices:
    """Return the index of the latest True in ``mask`` strictly before each instant, ``(T, ...)``; -1 for none."""
    return np.concatenate([np.full((1, *mask.shape[1:]), -1), last_instant(mask)[:-1]])


#: Number of distances that are computed at once, so that they fit the cache.
CHUNK = 1 << 18


class NearPairs(NamedTuple):
    """Pairs ``(P,)`` of an object and a track that are within the cutoff at an instant, in the order of instants."""

    instant: Indices
    object: Indices
    column: Indices
    """``(P,)`` column of each pair's track in the arrays ``(T, K)`` of tracks."""
    track: Indices
    """``(P,)`` number of each pair's track: each id has a number from 0."""
    distance: Array
    """``(P,)`` distance between object and track of each pair, m."""

    def where(self, mask: Mask) -> NearPairs:
        """Return the pairs that ``mask`` ``(P,)`` selects."""
        return NearPairs(
            self.instant[mask], self.object[mask], self.column[mask], self.track[mask], self.distance[mask]
        )

    def within(self, span: slice) -> NearPairs:
        """Return the pairs at the instants of the slice ``span``; its first instant becomes 0."""
        pairs = self.where((self.instant >= span.start) & (self.instant < span.stop))
        return pairs._replace(instant=pairs.instant - span.start)


def similarity(distance: Array, cutoff: float) -> Array:
    """Return the similarity of HOTA, CLEAR and IDF1: 1 at no distance, 0 at the cutoff."""
    return 1 - distance / cutoff


class Nearby(NamedTuple):
    """All objects and tracks of a run, and the pairs of them that are within the cutoff of each other."""

    cutoff: float
    """Largest distance between object and track in ``pairs`` and ``optional``, m."""
    due: Mask
    """``(T, N)`` where an object is due, that is, must be tracked."""
    there: Mask
    """``(T, K)`` where a column has a track."""
    track: Indices
    """``(T, K)`` number from 0 of the track in each column, -1 where a column is empty."""
    ids: Indices
    """``(tracks,)`` id of each track, by its number from 0."""
    pairs: NearPairs
    """Pairs of a due object and a track within the cutoff."""
    optional: NearPairs
    """Pairs of an optional object, which need not be tracked, and a track within the cutoff."""
    unscored: Mask
    """``(T, K)`` where a track is in a place that is not scored; such a track counts only if it is on a due object."""


class Counted(NamedTuple):
    """Objects and tracks of a run that count: due objects, and scored tracks that are on no optional object."""

    cutoff: float
    """Cutoff distance of GOSPA, m."""
    reach: float
    """Limit on the distance of a matched pair, m: the cutoff, or half of it where pairs are matched as in CLEAR."""
    due: Mask
    """``(T, N)`` where an object is due, that is, must be tracked."""
    present: Mask
    """``(T, K)`` where a track is scored."""
    track: Indices
    """``(T, K)`` number from 0 of the track in each column, -1 where a column is empty."""
    ids: Indices
    """``(tracks,)`` id of each track, by its number from 0."""
    pairs: NearPairs
    """Pairs, within the cutoff, of a due object and a track that counts."""
    matched: NearPairs
    """Pairs of a due object and the track that is matched with it."""
    excused: NearPairs
    """Pairs of an optional object and a track on it, which therefore does not count."""

    def until(self, end: int) -> Counted:
        """Return the objects and tracks that count before the instant ``end``."""
        return self._replace(
            due=self.due[:end],
            present=self.present[:end],
            track=self.track[:end],
            pairs=self.pairs.where(self.pairs.instant < end),
            matched=self.matched.where(self.matched.instant < end),
            excused=self.excused.where(self.excused.instant < end),
        )

    @property
    def object_counts(self) -> Indices:
        """Number of instants at which each object is due, ``(N,)``."""
        return np.asarray(self.due.sum(axis=0))

    @property
    def track_counts(self) -> Indices:
        """Number of instants at which each track counts, ``(tracks,)``."""
        return np.bincount(self.track[self.present], minlength=len(self.ids))


def nearby(truth: TruthHistory, tracks: TrackHistory, cutoff: float, unscored: Mask | None = None) -> Nearby:
    """Return pairs of objects and tracks within ``cutoff``, m; ``unscored``: ``(T, K)`` tracks not scored."""
    ids, track = _numbered(tracks.ids)
    there, exists = track >= 0, truth.status > ABSENT
    objects = _where(truth.state[:2], exists)
    if truth.at_tracks is not None:
        objects = _where(truth.at_tracks[:2], exists[..., None])
    pairs = near_pairs(objects, _where(tracks.mean[:2], there), track, cutoff)
    due = truth.status == DUE
    of_due = due[pairs.instant, pairs.object]
    unscored = np.zeros_like(there) if unscored is None else unscored & there
    return Nearby(cutoff, due, there, track, ids, pairs.where(of_due), pairs.where(~of_due), unscored)


def _numbered(ids: Indices) -> tuple[Indices, Indices]:
    largest = int(ids.max(initial=-1))
    if largest > 4 * ids.size:
        every, number = np.unique(ids, return_inverse=True)
        none = int(every[0] < 0)
        return every[none:], number.reshape(ids.shape) - none
    there = np.zeros(largest + 2, dtype=bool)
    # The index -1 has marked the last place.
    there[ids] = True
    there[-1] = False
    number = np.where(there, there.cumsum() - 1, -1)
    return there.nonzero()[0], number[ids]


def count_by_gospa(near: Nearby) -> Counted:
    """Match due objects with tracks as in GOSPA; return the objects and tracks that are scored, and the matched pairs.

    At each instant the matching is one-to-one. It has the smallest sum of the squared distances, plus half of the
    squared cutoff for each object and each track without a partner.
    """
    pairs = near.pairs
    gain = near.cutoff**2 - pairs.distance**2
    return excuse_tracks(near, best_matching(*pairs[:3], gain, near.due.shape[1], near.there.shape[1]), near.cutoff)


def excuse_tracks(near: Nearby, chosen: Mask, reach: float) -> Counted:
    """Return objects and tracks without the tracks on optional objects or in places that are not scored.

    The tracks without a due object are matched one-to-one with the optional objects within ``reach`` m, so that the sum
    of the distances is smallest. Tracks with an optional object are neither right nor wrong, and do not count.

    Args:
        near: all objects and tracks.
        chosen: ``(P,)`` True for the pairs of ``near`` that are matched.
        reach: largest distance of a matched pair, m.
    """
    matched, optional = near.pairs.where(chosen), near.optional
    left = near.there.copy()
    left[matched.instant, matched.column] = False
    optional = optional.where(left[optional.instant, optional.column] & (optional.distance <= reach))
    if len(optional.instant):
        gain = reach - optional.distance
        optional = optional.where(best_matching(*optional[:3], gain, near.due.shape[1], near.there.shape[1]))
    present = near.there & ~(near.unscored & left)
    present[optional.instant, optional.column] = False
    pairs = near.pairs.where(present[near.pairs.instant, near.pairs.column])
    return Counted(near.cutoff, reach, near.due, present, near.track, near.ids, pairs, matched, optional)


def near_pairs(objects: Array, tracks: Array, track: Indices, cutoff: float) -> NearPairs:
    """Return pairs of objects ``(2, T, N)`` (or ``(2, T, N, K)``) and tracks ``(2, T, K)`` within ``cutoff``, m."""
    steps, n, k = objects.shape[1], objects.shape[2], tracks.shape[2]
    at_once = max(1, CHUNK // max(1, n * k))
    cells, squares = [np.empty(0, dtype=np.intp)], [np.empty(0)]
    for start in range(0, steps, at_once):
        part = slice(start, start + at_once)
        square = _squared(objects[0, part], tracks[0, part])
        square += _squared(objects[1, part], tracks[1, part])
        square = square.reshape(-1)
        near = np.flatnonzero(square <= cutoff**2)
        cells.append(near + start * n * k)
        squares.append(square[near])
    cell, column = np.divmod(np.concatenate(cells), max(1, k))
    instant, item = np.divmod(cell, max(1, n))
    return NearPairs(instant, item, column, track[instant, column], np.sqrt(np.concatenate(squares)))


def _squared(a: Array, b: Array) -> Array:
    difference = (a if a.ndim == 3 else a[:, :, None]) - b[:, None]
    return np.multiply(difference, difference, out=difference)


def _where(position: Array, there: Mask) -> Array:
    return np.where(there, position, np.nan)
