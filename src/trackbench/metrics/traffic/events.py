"""What happened: where tracks were born, objects lost and found, identities switched, and what each event cost."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.traffic.assignment import Counted, NearPairs, TrackHistory, TruthHistory
from trackbench.metrics.traffic.mot_metrics import NO_TRACK, NOBODY, Switches, object_of_each

#: What an object's strip says of an instant. WAITING: due, and not yet tracked. SWITCHED: by another track than last.
NOT_DUE, WAITING, TRACKED, SWITCHED, LOST = range(5)
#: Their names.
STATES = ("not due", "waiting", "tracked", "switched", "lost")


def strips(track_of: Indices, due: Mask, changes: Switches) -> npt.NDArray[np.int8]:
    """``(T, N)`` NOT_DUE, WAITING, TRACKED, SWITCHED or LOST."""
    tracked = track_of != NO_TRACK
    untracked = np.where(np.logical_or.accumulate(tracked, axis=0), LOST, WAITING)
    states = np.where(due, np.where(tracked, TRACKED, untracked), NOT_DUE).astype(np.int8)
    states[changes.instant, changes.object] = SWITCHED
    return states


class Stretches(NamedTuple):
    """Stretches ``(S,)`` of instants at which an object, or a track, is there and has a partner or has none."""

    owner: Indices
    """Number of the object or track, in increasing order."""
    paired: Mask
    start: Indices
    """Instant."""
    before: Indices
    """The owner's last instant before, -1 where this is its first stretch."""
    cost: Array
    """Sum over its instants."""
    last: Mask
    """Whether it is the owner's last stretch."""


def _paired_stretches(there: Mask, paired: Mask, cost: Array) -> Stretches:
    """Instants at which the owner is not there are passed over.

    Args:
        there: ``(T, owners)``.
        paired: ``(T, owners)``.
        cost: ``(T, owners)`` of each instant.
    """
    owner, instant = np.nonzero(there.T)
    with_partner = paired[instant, owner]
    changes = (owner[1:] != owner[:-1]) | (with_partner[1:] != with_partner[:-1])
    start = np.flatnonzero(np.concatenate([[True], changes])) if len(owner) else np.empty(0, dtype=np.intp)
    own = owner[start]
    first = np.concatenate([[True], own[1:] != own[:-1]])[: len(own)]
    before = np.where(first, -1, instant[np.maximum(start - 1, 0)])
    last = np.concatenate([own[1:] != own[:-1], [True]])[: len(own)]
    total = np.add.reduceat(cost[instant, owner], start) if len(start) else np.empty(0)
    return Stretches(own, with_partner[start], instant[start], before, total, last)


NONE = -1


class Costs(NamedTuple):
    """The parts of squared GOSPA of missed objects and false tracks, m^2, by whose they are."""

    missed: Array
    """``(T, N)``."""
    false: Array
    """``(T, tracks)``."""


class _Partners(NamedTuple):
    column: Indices
    """``(T, N)`` of the track of each object."""
    object: Indices
    """``(T, K)`` of each column."""

    def add(self, pairs: NearPairs) -> None:
        self.column[pairs.instant, pairs.object] = pairs.column
        self.object[pairs.instant, pairs.column] = pairs.object


def _event_costs(of_gospa: Counted, of_clear: Counted) -> Costs:
    """Half of the squared cutoff for each due object and each track that GOSPA leaves without a partner.

    CLEAR, by whose matching events are told, can have a partner for it that GOSPA gives to another one, which in CLEAR
    has yet another partner, and so on. The cost goes to the last of this chain, which is the one too many in CLEAR.
    """
    half, due, track = of_gospa.cutoff**2 / 2, of_gospa.due, of_gospa.track
    gospa, clear = (_Partners(np.full(due.shape, NONE), np.full(track.shape, NONE)) for _ in range(2))
    gospa.add(of_gospa.matched)
    clear.add(of_clear.matched)
    missed, false = np.zeros(due.shape), np.zeros((len(due), len(of_gospa.ids)))
    instant, item = np.nonzero(due & (gospa.column == NONE))
    np.add.at(missed, (instant, _last_of_chain(instant, item, clear.column, gospa.object)), half)
    gospa.add(of_gospa.excused)
    clear.add(of_clear.excused)
    instant, column = np.nonzero(of_gospa.present & (gospa.object == NONE))
    column = _last_of_chain(instant, column, clear.object, gospa.column)
    np.add.at(false, (instant, track[instant, column]), half)
    return Costs(missed, false)


def _last_of_chain(instant: Indices, item: Indices, partner: Indices, owner: Indices) -> Indices:
    """From each item to the owner of its partner, as long as there is one."""
    item, moving = item.copy(), np.arange(len(item))
    while len(moving):
        other = partner[instant[moving], item[moving]]
        moving, other = moving[other != NONE], other[other != NONE]
        following = owner[instant[moving], other]
        moving, following = moving[following != NONE], following[following != NONE]
        item[moving] = following
    return item


EventKind = Literal["born", "confirmed", "switched", "lost", "merged", "false", "fragmented"]


class TrafficEvent(NamedTuple):
    """One row of the table of events."""

    kind: EventKind
    """born: a track is there for the first time. confirmed: an object is tracked for the first time. switched: an
    object has another track than last. lost: a due object has no track any more, or never had one. merged: the same,
    while its track is there, near an object that has another track. false: a track is on no object from here on.
    fragmented: a lost object is tracked again."""
    instant: int
    time: float
    """s."""
    track: int
    """Id of the track that the event is about, -1 where there is none."""
    object: int
    """Number of the object, -1 where there is none."""
    other_track: int
    """switched: id of the former track; merged: of the track that the other object has. Else -1."""
    other_object: int
    """switched, lost: the object that the former track is on now; merged: the object that it is near. Else -1."""
    x: float
    """m, of the object, or of the track where there is none."""
    y: float
    cost: float
    """m^2, by :func:`_event_costs`: the part of squared GOSPA that is due to what is missed or false. confirmed: of the
    instants before without a track; lost, merged: of those until it has one; false: of those until the track is on an
    object. switched: as in T-GOSPA."""
    why: str


class _Timeline(NamedTuple):
    truth: TruthHistory
    tracks: TrackHistory
    counted: Counted
    track_of: Indices
    """``(T, N)``."""
    object_of: Indices
    """``(T, tracks)`` the due object of each."""
    optional_of: Indices
    """``(T, tracks)`` the optional object of each."""
    column_of: Indices
    """``(T, tracks)``, -1 where the track is not there."""
    counts: Mask
    """``(T, tracks)`` where the track counts."""
    costs: Costs

    def event(
        self,
        kind: EventKind,
        instant: int,
        track: int,
        item: int,
        why: str,
        cost: float = 0.0,
        other_track: int = NO_TRACK,
        other_object: int = NOBODY,
    ) -> TrafficEvent:
        """Tracks by their numbers."""
        if item != NOBODY:
            x, y = self.truth.state[:2, instant, item].tolist()
        else:
            x, y = self.tracks.mean[:2, instant, self.column_of[instant, track]].tolist()
        ids = [NO_TRACK if number == NO_TRACK else int(self.counted.ids[number]) for number in (track, other_track)]
        time = float(self.truth.time[instant])
        return TrafficEvent(kind, instant, time, ids[0], item, ids[1], other_object, x, y, cost, why)


def events(
    truth: TruthHistory,
    tracks: TrackHistory,
    counted: Counted,
    of_gospa: Counted,
    track_of: Indices,
    changes: Switches,
    switch: float,
) -> tuple[TrafficEvent, ...]:
    """In the order of time. Their costs without those of switches sum to GOSPA's parts of missed objects and false
    tracks.

    Args:
        truth: objects.
        tracks: tracks.
        counted: what counts of both, matched by :func:`clear_matches`.
        of_gospa: the same, matched as in GOSPA.
        track_of: of the first.
        changes: of the same.
        switch: m that a switch costs.
    """
    steps, numbers = len(truth.time), len(counted.ids)
    column_of = np.full((steps, numbers), NO_TRACK)
    instant, column = np.nonzero(counted.track >= 0)
    column_of[instant, counted.track[instant, column]] = column
    object_of, optional_of = (object_of_each(pairs, steps, numbers) for pairs in (counted.matched, counted.excused))
    counts = np.zeros(column_of.shape, dtype=bool)
    instant, column = np.nonzero(counted.present)
    counts[instant, counted.track[instant, column]] = True
    shared = _event_costs(of_gospa, counted)
    line = _Timeline(truth, tracks, counted, track_of, object_of, optional_of, column_of, counts, shared)
    rows = [*_births(line), *_of_objects(line), *_of_tracks(line), *_of_gospa_alone(line)]
    rows += _switched(line, changes, switch**2)
    return tuple(sorted(rows, key=lambda event: event.instant))


def _births(line: _Timeline) -> Iterator[TrafficEvent]:
    for track, instant in enumerate((line.column_of != NO_TRACK).argmax(axis=0).tolist()):
        item = int(line.object_of[instant, track])
        optional = line.optional_of[instant, track] != NOBODY
        elsewhere = "on no object" if line.counts[instant, track] else "where nothing counts"
        why = "on an object" if item != NOBODY else "on an optional object" if optional else elsewhere
        yield line.event("born", instant, track, item, why)


def _of_objects(line: _Timeline) -> Iterator[TrafficEvent]:
    time = line.truth.time
    spans = _paired_stretches(line.counted.due, line.track_of != NO_TRACK, line.costs.missed)
    waited: float | None = None
    since = 0
    for item, paired, start, before, cost, last in zip(*(values.tolist() for values in spans), strict=True):
        if not paired:
            since = start
            if before >= 0:
                yield _loss(line, start, item, int(line.track_of[before, item]), cost)
            elif last:
                yield line.event("lost", start, NO_TRACK, item, "it never had a track", cost)
            else:
                waited = cost
            continue
        track = int(line.track_of[start, item])
        if before < 0:
            yield line.event("confirmed", start, track, item, "as soon as it was due")
        elif waited is not None:
            why = f"{time[start] - time[since]:.2f} s after it was due"
            yield line.event("confirmed", start, track, item, why, waited)
            waited = None
        else:
            why = f"{time[start] - time[since]:.2f} s after it was lost"
            yield line.event("fragmented", start, track, item, why)


def _loss(line: _Timeline, instant: int, item: int, former: int, cost: float) -> TrafficEvent:
    if line.column_of[instant, former] == NO_TRACK:
        return line.event("lost", instant, former, item, "its track ended", cost)
    now_on = int(line.object_of[instant, former])
    if now_on != NOBODY:
        return line.event("lost", instant, former, item, "its track went to another object", cost, other_object=now_on)
    if line.optional_of[instant, former] != NOBODY:
        return line.event("lost", instant, former, item, "its track went to an optional object", cost)
    pairs = line.counted.pairs
    start, end = np.searchsorted(pairs.instant, [instant, instant + 1])
    own = (pairs.track[start:end] == former) & (pairs.distance[start:end] <= line.counted.reach)
    near = start + np.flatnonzero(own)
    if not len(near):
        return line.event("lost", instant, former, item, "its track left it", cost)
    other = int(pairs.object[near[np.argmin(pairs.distance[near])]])
    why = "its track is near an object that has another track"
    return line.event("merged", instant, former, item, why, cost, int(line.track_of[instant, other]), other)


def _of_tracks(line: _Timeline) -> Iterator[TrafficEvent]:
    spans = _paired_stretches(line.counts, line.object_of != NOBODY, line.costs.false)
    for track, paired, start, before, cost, _ in zip(*(values.tolist() for values in spans), strict=True):
        if paired:
            continue
        why = "it began on no object"
        if before >= 0:
            left = line.counted.due[start, line.object_of[before, track]]
            why = "it left its object" if left else "its object is not there any more"
        yield line.event("false", start, track, NOBODY, why, cost)


def _of_gospa_alone(line: _Timeline) -> Iterator[TrafficEvent]:
    """What CLEAR has together, and GOSPA not: one event for each object and each track."""
    missed = np.where(line.track_of == NO_TRACK, 0, line.costs.missed)
    for item in np.flatnonzero(missed.any(axis=0)).tolist():
        instant = int(np.argmax(missed[:, item] > 0))
        why, cost = "GOSPA gives its track to another object", float(missed[:, item].sum())
        yield line.event("lost", instant, int(line.track_of[instant, item]), item, why, cost)
    false = np.where(line.counts & (line.object_of == NOBODY), 0, line.costs.false)
    for track in np.flatnonzero(false.any(axis=0)).tolist():
        instant = int(np.argmax(false[:, track] > 0))
        why, cost = "GOSPA gives its object to another track", float(false[:, track].sum())
        yield line.event("false", instant, track, NOBODY, why, cost)


def _switched(line: _Timeline, changes: Switches, cost: float) -> Iterator[TrafficEvent]:
    for instant, item, before, after in zip(*(values.tolist() for values in changes), strict=True):
        now_on = int(line.object_of[instant, before])
        if line.column_of[instant, before] == NO_TRACK:
            why = "its former track ended"
        elif now_on != NOBODY:
            why = "its former track is on another object"
        else:
            why = "its former track is on no object"
        yield line.event("switched", instant, after, item, why, cost, before, now_on)
