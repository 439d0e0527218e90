"""What is scored of a run, which tracks are near which objects, and which count: computed once for all scores."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import ABSENT, DUE, Array, Indices, Mask
from trackbench.trackers.multi.association import best_assignment

#: In place of the origin of a detection: the track took none.
NO_DETECTION = -2

Status = npt.NDArray[np.int8]


class TrafficScoreOptions(NamedTuple):
    """What is asked of a track."""

    cutoff: float = 5.0
    """m: distance of GOSPA, and of no similarity; up to half of it a track is on an object."""
    switch_costs: float = 0.5
    """s: a switch costs as much in T-GOSPA as missing the object for so long."""

    def switch(self, spacing: float) -> float:
        """Return the cost of an identity switch, m, where the instants are ``spacing`` s apart."""
        return self.cutoff * float(np.sqrt(self.switch_costs / spacing / 2)) if spacing else 0.0


class TruthHistory(NamedTuple):
    """T instants of N objects."""

    time: Array
    """``(T,)`` s, increasing."""
    state: Array
    """``(4, T, N)`` px, py, vx, vy in the fixed frame."""
    status: Status
    """``(T, N)``: ``ABSENT``, ``OPTIONAL`` (a track on it is neither right nor wrong) or ``DUE``."""
    at_tracks: Array | None = None
    """``(4, T, N, K)`` the objects at the time stamps of the tracks, where those of an instant have several."""

    def within(self, span: slice) -> TruthHistory:
        """At some of the instants."""
        at_tracks = None if self.at_tracks is None else self.at_tracks[:, span]
        return TruthHistory(self.time[span], self.state[:, span], self.status[span], at_tracks)

    def at(self, instant: Indices, item: Indices, column: Indices) -> Array:
        """``(4, P)`` the objects as tracks are to have them."""
        if self.at_tracks is not None:
            return self.at_tracks[:, instant, item, column]
        return self.state[:, instant, item]


class TrackHistory(NamedTuple):
    """The tracks that a tracker gave at the T instants, in K columns of no meaning."""

    ids: Indices
    """``(T, K)``, -1 where a column is empty."""
    mean: Array
    """``(4, T, K)``."""
    covariance: Array
    """``(4, 4, T, K)``."""
    existence: Array | None = None
    """``(T, K)``."""

    def within(self, span: slice) -> TrackHistory:
        """At some of the instants."""
        existence = None if self.existence is None else self.existence[span]
        return TrackHistory(self.ids[span], self.mean[:, span], self.covariance[:, :, span], existence)


class Associations(NamedTuple):
    """Which detection each track took in each of S scans, and what caused it."""

    instant: Indices
    """``(S,)`` the instant of each scan, in order."""
    ids: Indices
    """``(S, K)`` the tracks after the scan, -1 where a column is empty."""
    origin: Indices
    """``(S, K)`` the object that caused the detection, ``FALSE_ALARM``, or ``NO_DETECTION`` where none was taken."""
    detected: Mask
    """``(S, N)`` which objects caused a detection in the scan."""
    merged: Indices | None = None
    """``(S, K)`` the second object of a detection that two objects caused, else negative."""

    def within(self, span: slice) -> Associations:
        """In the scans at some of the instants, from ``span.start`` up to ``span.stop``."""
        own = slice(*np.searchsorted(self.instant, [span.start, span.stop]))
        merged = None if self.merged is None else self.merged[own]
        return Associations(self.instant[own] - span.start, self.ids[own], self.origin[own], self.detected[own], merged)


def best_matching(group: Indices, row: Indices, column: Indices, gain: Array, rows: int, columns: int) -> Mask:
    """``(P,)`` which of the pairs are matched, so that the gain of each group is largest.

    Args:
        group: ``(P,)``
        row: ``(P,)`` below ``rows``.
        column: ``(P,)`` below ``columns``; a row and a column meet at most once in a group.
        gain: ``(P,)``; pairs that gain nothing are not matched.
    """
    chosen = np.zeros(len(group), dtype=bool)
    chosen[best_assignment(group * rows + row, group * columns + column, gain, group)] = True
    return chosen


def equal_stretches(group: Indices) -> list[slice]:
    """The stretches of equal numbers."""
    if not len(group):
        return []
    ends = [*(np.flatnonzero(group[1:] != group[:-1]) + 1).tolist(), len(group)]
    return [slice(start, end) for start, end in zip([0, *ends[:-1]], ends, strict=True)]


def among(values: Indices, some: Indices) -> Mask:
    """Which of the values, 0 or more, are among some of them."""
    mark = np.zeros(values.max() + 1, dtype=bool)
    mark[some] = True
    return mark[values]


def last_instant(mask: Mask) -> Indices:
    """``(T, ...)`` the last instant up to each, with it, at which ``mask`` is True; -1 where there is none."""
    steps = np.arange(len(mask)).reshape(-1, *[1] * (mask.ndim - 1))
    return np.asarray(np.maximum.accumulate(np.where(mask, steps, -1), axis=0))


def last_instant_before(mask: Mask) -> Indices:
    """``(T, ...)`` the same without the instant itself."""
    return np.concatenate([np.full((1, *mask.shape[1:]), -1), last_instant(mask)[:-1]])


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

    def within(self, span: slice) -> NearPairs:
        """Those at some of the instants, which are numbered from the first of them."""
        own = self.where((self.instant >= span.start) & (self.instant < span.stop))
        return own._replace(instant=own.instant - span.start)


def similarity(distance: Array, cutoff: float) -> Array:
    """From 1 at no distance to 0 at the cutoff, as HOTA, CLEAR and identity take it."""
    return 1 - distance / cutoff


class Nearby(NamedTuple):
    """All objects and tracks of a run, and the pairs of them that are within the cutoff of each other."""

    cutoff: float
    """m."""
    due: Mask
    """``(T, N)``."""
    there: Mask
    """``(T, K)`` the tracks."""
    track: Indices
    """``(T, K)`` the number of each track, -1 where a column is empty."""
    ids: Indices
    """``(tracks,)`` the id of each number."""
    pairs: NearPairs
    """Of due objects."""
    optional: NearPairs
    """Of optional ones."""
    unscored: Mask
    """``(T, K)`` tracks where nothing counts: such a track is right on a due object, and else does not count."""


class Counted(NamedTuple):
    """What counts in a run: the due objects, and the tracks that are on no optional one, where anything counts."""

    cutoff: float
    """m."""
    reach: float
    """m, up to which a track is matched."""
    due: Mask
    """``(T, N)``."""
    present: Mask
    """``(T, K)``: the tracks that count."""
    track: Indices
    """``(T, K)`` the number of each track, -1 where a column is empty."""
    ids: Indices
    """``(tracks,)`` the id of each number."""
    pairs: NearPairs
    """Of those that count."""
    matched: NearPairs
    """Those of them that are matched."""
    excused: NearPairs
    """Optional objects with the tracks that therefore do not count."""

    def until(self, end: int) -> Counted:
        """What counts before an instant."""
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
        """``(N,)`` instants at which each object is due."""
        return np.asarray(self.due.sum(axis=0))

    @property
    def track_counts(self) -> Indices:
        """``(tracks,)`` instants at which each track counts."""
        return np.bincount(self.track[self.present], minlength=len(self.ids))


def nearby(truth: TruthHistory, tracks: TrackHistory, cutoff: float, unscored: Mask | None = None) -> Nearby:
    """What may be matched, ``cutoff`` in m; ``unscored`` as in ``Nearby``, none unless given."""
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
    """The ids that are there, ascending, and the number among them of each, -1 where there is none."""
    largest = int(ids.max(initial=-1))
    if largest > 4 * ids.size:
        every, number = np.unique(ids, return_inverse=True)
        none = int(every[0] < 0)
        return every[none:], number.reshape(ids.shape) - none
    there = np.zeros(largest + 2, dtype=bool)
    # The last place is that of -1.
    there[ids] = True
    there[-1] = False
    number = np.where(there, there.cumsum() - 1, -1)
    return there.nonzero()[0], number[ids]


def count_by_gospa(near: Nearby) -> Counted:
    """What counts for GOSPA and its like: due objects are matched as in GOSPA, with the cutoff for both kinds.

    At each instant due objects and tracks are matched one-to-one so that the sum of the squared distances, with half of
    the squared cutoff for each object and each track without partner, is smallest.
    """
    pairs = near.pairs
    gain = near.cutoff**2 - pairs.distance**2
    return excusing(near, best_matching(*pairs[:3], gain, near.due.shape[1], near.there.shape[1]), near.cutoff)


def excusing(near: Nearby, chosen: Mask, reach: float) -> Counted:
    """Leave out the tracks that are on optional objects, or where nothing counts.

    The tracks that no due object has are matched one-to-one with the optional objects within ``reach`` m, so that the
    sum of the distances is smallest. Those with a partner are neither right nor wrong: they do not count.

    Args:
        near: all objects and tracks.
        chosen: ``(P,)`` which of its pairs are matched.
        reach: m, up to which a track is matched.
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
    """The pairs within ``cutoff`` of positions ``(2, T, N)`` and ``(2, T, K)`` m, NaN where there is nothing; objects
    ``(2, T, N, K)`` where they are elsewhere for each track."""
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
