"""Events of a run: births of tracks, confirmations, losses and identity switches, each with its cost in GOSPA."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.traffic.assignment import Counted, NearPairs, TrackHistory, TruthHistory
from trackbench.metrics.traffic.mot_metrics import NO_TRACK, NOBODY, Switches, object_of_each

#: States of an object at an instant. WAITING: due and not yet tracked. SWITCHED: tracked by another track than last.
NOT_DUE, WAITING, TRACKED, SWITCHED, LOST = range(5)
#: Names of the states.
STATES = ("not due", "waiting", "tracked", "switched", "lost")


def strips(track_of: Indices, due: Mask, changes: Switches) -> npt.NDArray[np.int8]:
    """Return each object's state at each instant, ``(T, N)``: index in ``STATES``, such as waiting, tracked or lost."""
    tracked = track_of != NO_TRACK
    untracked = np.where(np.logical_or.accumulate(tracked, axis=0), LOST, WAITING)
    states = np.where(due, np.where(tracked, TRACKED, untracked), NOT_DUE).astype(np.int8)
    states[changes.instant, changes.object] = SWITCHED
    return states


class Stretches(NamedTuple):
    """Stretches ``(S,)`` of instants at which an object or a track, the owner, always or never has a match."""

    owner: Indices
    """``(S,)`` number of the object or track that owns each stretch, in increasing order."""
    paired: Mask
    """``(S,)`` whether the owner is matched throughout each stretch; else it never is in the stretch."""
    start: Indices
    """``(S,)`` index of the first instant of each stretch."""
    before: Indices
    """``(S,)`` index of the owner's last instant before each stretch, -1 for the first stretch of the owner."""
    cost: Array
    """``(S,)`` sum of the owner's costs over the instants of each stretch, in the unit of the given costs."""
    last: Mask
    """``(S,)`` whether each stretch is the last stretch of its owner."""


def _paired_stretches(there: Mask, paired: Mask, cost: Array) -> Stretches:
    """Return the stretches of owners from arrays ``(T, owners)``; instants without the owner are passed over."""
    owner, instant = np.nonzero(there.T)
    with_partner = paired[instant, owner]
    changes = (owner[1:] != owner[:-1]) | (with_partner[1:] != with_partner[:-1])
    start = np.flatnonzero(np.concatenate([[True], changes])) if len(owner) else np.empty(0, dtype=np.intp)
    owners = owner[start]
    first = np.concatenate([[True], owners[1:] != owners[:-1]])[: len(owners)]
    before = np.where(first, -1, instant[np.maximum(start - 1, 0)])
    last = np.concatenate([owners[1:] != owners[:-1], [True]])[: len(owners)]
    total = np.add.reduceat(cost[instant, owner], start) if len(start) else np.empty(0)
    return Stretches(owners, with_partner[start], instant[start], before, total, last)


NONE = -1


class Costs(NamedTuple):
    """Parts of squared GOSPA, m^2, from each missed object and from each false track, at each instant."""

    missed: Array
    """``(T, N)`` cost of each object without a track."""
    false: Array
    """``(T, tracks)`` cost of each track without an object."""


class _Partners(NamedTuple):
    column: Indices
    """``(T, N)`` column of the track that each object is matched with; ``NONE`` for none."""
    object: Indices
    """``(T, K)`` index of the object that the track in each column is matched with; ``NONE`` for none."""

    def add(self, pairs: NearPairs) -> None:
        self.column[pairs.instant, pairs.object] = pairs.column
        self.object[pairs.instant, pairs.column] = pairs.object


def _event_costs(of_gospa: Counted, of_clear: Counted) -> Costs:
    """Return the cost in GOSPA of each missed object and each false track, assigned to objects and tracks by CLEAR.

    Each due object and each track that GOSPA leaves without a match costs half of the squared cutoff. Events follow the
    matching of CLEAR. An object without a track in GOSPA can have a track in CLEAR, which GOSPA matches with another
    object, which again can have a track in CLEAR, and so on. The last object of this chain has no track in CLEAR and
    gets the cost. Tracks are treated alike.
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
    """Return the last object (or track) of the chain of matches, in CLEAR and GOSPA by turns, that each one starts."""
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
    """Event of a track or an object, such as a confirmation or an identity switch: a row of the table of events."""

    kind: EventKind
    """born: first instant of a track. confirmed: an object gets its first track. switched: an object has another track
    than before. lost: an object that should be tracked loses its track, or never gets one. merged: an object is lost,
    and its former track is near an object that has another track. false: a track begins to be on no object. fragmented:
    a lost object is tracked again."""
    instant: int
    time: float
    """Time of the event, s."""
    track: int
    """Id of the track that the event is about, -1 where there is none."""
    object: int
    """Number of the object that the event is about, -1 where there is none."""
    other_track: int
    """switched: id of the former track; merged: id of the other object's track; else -1."""
    other_object: int
    """Number of a second object. switched, lost: object to which the object's former track is assigned now; merged:
    object near that track. -1 for other kinds of event."""
    x: float
    """x of the object, or of the track where there is no object, m."""
    y: float
    cost: float
    """Part of squared GOSPA, m^2, from a missed object or a false track. confirmed: over the instants before at which
    the object had no track; lost, merged: over the instants until the object has a track; false: over the instants
    until the track is on an object. switched: cost of a switch in T-GOSPA."""
    why: str


class _MatchedRun(NamedTuple):
    truth: TruthHistory
    tracks: TrackHistory
    counted: Counted
    track_of: Indices
    """``(T, N)`` number of the track of each object, -1 for none."""
    object_of: Indices
    """``(T, tracks)`` index of the due object that each track is on, -1 for none."""
    optional_of: Indices
    """``(T, tracks)`` index of the optional object that each track is on, -1 for none."""
    column_of: Indices
    """``(T, tracks)`` column of each track in the arrays ``(T, K)`` of tracks, -1 where the track is missing."""
    counts: Mask
    """``(T, tracks)`` where the track is scored."""
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
        """Return an event of a track or object; the numbers ``track`` and ``other_track`` become track ids."""
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
    """Return births, confirmations, losses, switches and other events of a run in the order of time.

    The costs of events other than switches add up to the missed and false parts of GOSPA.

    Args:
        truth: true states of the objects.
        tracks: tracks that the tracker gave.
        counted: objects and tracks that count, matched as in CLEAR.
        of_gospa: objects and tracks that count, matched as in GOSPA.
        track_of: ``(T, N)`` number of the track that CLEAR matches with each object.
        changes: identity switches as CLEAR counts them.
        switch: cost of an identity switch, m.
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
    run = _MatchedRun(truth, tracks, counted, track_of, object_of, optional_of, column_of, counts, shared)
    rows = [*_births(run), *_object_events(run), *_false_tracks(run), *_events_of_gospa_alone(run)]
    rows += _switch_events(run, changes, switch**2)
    return tuple(sorted(rows, key=lambda event: event.instant))


def _births(run: _MatchedRun) -> Iterator[TrafficEvent]:
    for track, instant in enumerate((run.column_of != NO_TRACK).argmax(axis=0).tolist()):
        item = int(run.object_of[instant, track])
        optional = run.optional_of[instant, track] != NOBODY
        elsewhere = "on no object" if run.counts[instant, track] else "where nothing counts"
        why = "on an object" if item != NOBODY else "on an optional object" if optional else elsewhere
        yield run.event("born", instant, track, item, why)


def _object_events(run: _MatchedRun) -> Iterator[TrafficEvent]:
    time = run.truth.time
    spans = _paired_stretches(run.counted.due, run.track_of != NO_TRACK, run.costs.missed)
    waited: float | None = None
    since = 0
    for item, paired, start, before, cost, last in zip(*(values.tolist() for values in spans), strict=True):
        if not paired:
            since = start
            if before >= 0:
                yield _loss(run, start, item, int(run.track_of[before, item]), cost)
            elif last:
                yield run.event("lost", start, NO_TRACK, item, "it never had a track", cost)
            else:
                waited = cost
            continue
        track = int(run.track_of[start, item])
        if before < 0:
            yield run.event("confirmed", start, track, item, "as soon as it was due")
        elif waited is not None:
            why = f"{time[start] - time[since]:.2f} s after it was due"
            yield run.event("confirmed", start, track, item, why, waited)
            waited = None
        else:
            why = f"{time[start] - time[since]:.2f} s after it was lost"
            yield run.event("fragmented", start, track, item, why)


def _loss(run: _MatchedRun, instant: int, item: int, former: int, cost: float) -> TrafficEvent:
    if run.column_of[instant, former] == NO_TRACK:
        return run.event("lost", instant, former, item, "its track ended", cost)
    now_on = int(run.object_of[instant, former])
    if now_on != NOBODY:
        return run.event("lost", instant, former, item, "its track went to another object", cost, other_object=now_on)
    if run.optional_of[instant, former] != NOBODY:
        return run.event("lost", instant, former, item, "its track went to an optional object", cost)
    pairs = run.counted.pairs
    start, end = np.searchsorted(pairs.instant, [instant, instant + 1])
    is_near = (pairs.track[start:end] == former) & (pairs.distance[start:end] <= run.counted.reach)
    near = start + np.flatnonzero(is_near)
    if not len(near):
        return run.event("lost", instant, former, item, "its track left it", cost)
    other = int(pairs.object[near[np.argmin(pairs.distance[near])]])
    why = "its track is near an object that has another track"
    return run.event("merged", instant, former, item, why, cost, int(run.track_of[instant, other]), other)


def _false_tracks(run: _MatchedRun) -> Iterator[TrafficEvent]:
    spans = _paired_stretches(run.counts, run.object_of != NOBODY, run.costs.false)
    for track, paired, start, before, cost, _ in zip(*(values.tolist() for values in spans), strict=True):
        if paired:
            continue
        why = "it began on no object"
        if before >= 0:
            left = run.counted.due[start, run.object_of[before, track]]
            why = "it left its object" if left else "its object is not there any more"
        yield run.event("false", start, track, NOBODY, why, cost)


def _events_of_gospa_alone(run: _MatchedRun) -> Iterator[TrafficEvent]:
    """Yield one event for each object and each track that CLEAR matches where GOSPA does not."""
    missed = np.where(run.track_of == NO_TRACK, 0, run.costs.missed)
    for item in np.flatnonzero(missed.any(axis=0)).tolist():
        instant = int(np.argmax(missed[:, item] > 0))
        why, cost = "GOSPA gives its track to another object", float(missed[:, item].sum())
        yield run.event("lost", instant, int(run.track_of[instant, item]), item, why, cost)
    false = np.where(run.counts & (run.object_of == NOBODY), 0, run.costs.false)
    for track in np.flatnonzero(false.any(axis=0)).tolist():
        instant = int(np.argmax(false[:, track] > 0))
        why, cost = "GOSPA gives its object to another track", float(false[:, track].sum())
        yield run.event("false", instant, track, NOBODY, why, cost)


def _switch_events(run: _MatchedRun, changes: Switches, cost: float) -> Iterator[TrafficEvent]:
    for instant, item, before, after in zip(*(values.tolist() for values in changes), strict=True):
        now_on = int(run.object_of[instant, before])
        if run.column_of[instant, before] == NO_TRACK:
            why = "its former track ended"
        elif now_on != NOBODY:
            why = "its former track is on another object"
        else:
            why = "its former track is on no object"
        yield run.event("switched", instant, after, item, why, cost, before, now_on)
