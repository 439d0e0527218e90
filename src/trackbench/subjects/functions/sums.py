"""A function's decisions on tracks and on the truth: which activity answers which, and what is kept of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from trackbench.base.types import SAME_TIME, Array, Indices, Mask
from trackbench.metrics.ego import EgoScene
from trackbench.metrics.protocol import Chunk, Scope
from trackbench.subjects.functions.path import on_path
from trackbench.subjects.functions.protocol import NO_OBJECT, NOMINAL_SIZE, Decision, Function, Objects

if TYPE_CHECKING:
    from trackbench.metrics.traffic import TrackedRun

#: Shorter gaps in an activity do not end it, s; and what is so near to an event answers it.
TOLERANCE = 0.5
#: Of a delay, s.
DECIMALS = 9


class Spans(NamedTuple):
    """Intervals ``(N,)`` in which a function is active, in the order of runs and time."""

    run: Indices
    start: Indices
    """The first instant."""
    stop: Indices
    """The first one after it; the number of instants where it lasts to the end."""


def spans(active: Mask, time: Array) -> Spans:
    """The intervals of activity ``(instants, runs)`` at times ``(instants,)`` s; those less than ``TOLERANCE`` apart
    are one."""
    padded = np.zeros((active.shape[1], len(active) + 2), dtype=np.int8)
    padded[:, 1:-1] = active.T
    change = np.diff(padded, axis=1)
    (run, start), (_, stop) = np.nonzero(change > 0), np.nonzero(change < 0)
    if not len(run):
        return Spans(run, start, stop)
    # The next one begins before the end where it is of the same run.
    pause = time[start[1:]] - time[np.minimum(stop[:-1], len(time) - 1)]
    apart = (run[1:] != run[:-1]) | (pause >= TOLERANCE - SAME_TIME)
    first, last = np.append(True, apart), np.append(apart, True)
    return Spans(run[first], start[first], stop[last])


class Answers(NamedTuple):
    """What became of the events ``(events,)`` of the truth and of the intervals ``(N,)`` of a tracker."""

    delay: Array
    """From the start of an event to that of the interval that answers it, s; below 0 where it is early, and at least
    ``-TOLERANCE``. Of a missing answer it is later than of any."""
    missing: Mask
    false: Mask
    """``(N,)`` the intervals that answer no event, or that begin too early."""


def match_events(events: Spans, own: Spans, time: Array, impact: Array) -> Answers:
    """Match the intervals of a tracker with the events.

    An interval answers an event where it is active in it, or begins up to ``TOLERANCE`` after its end; of several the
    first counts. One that has gone on since the event before begins, for the next one, at that event's end. An interval
    is false where it begins near no event, even if it goes on into one, or is over before the one that it is near.

    Args:
        events: of the truth.
        own: intervals of the tracker.
        time: ``(instants,)`` s.
        impact: ``(runs,)`` s when it ends everything; infinite where there is none. A missing answer counts as given
            then, or ``TOLERANCE`` after the end of the event.
    """
    reach = TOLERANCE + SAME_TIME
    ends = np.append(time, time[-1])
    # The runs follow each other, so far apart that nothing of two of them is near.
    apart = time[-1] - time[0] + 4 * reach
    begin, end = (ends[at] + events.run * apart for at in (events.start, events.stop))
    own_begin = ends[own.start] + own.run * apart
    # The same in instants: an interval may last to the end.
    first, own_stop = (at + each.run * len(ends) for at, each in ((events.start, events), (own.stop, own)))
    candidate = np.searchsorted(own_stop, first, side="right")
    begins = np.append(own_begin, np.inf)[candidate]
    missing = begins > end + reach
    # Of times of one run, so that rounding is no delay.
    answered = np.append(ends[own.start], 0.0)[candidate]
    going_on = np.append(False, (events.run[1:] == events.run[:-1]) & (begins[1:] < end[:-1]))
    answered = np.where(going_on, np.append(0.0, ends[events.stop[:-1]]), answered)
    latest = np.minimum(ends[events.stop] + TOLERANCE, impact[events.run])
    # Times are sums of periods: so many scans are the same delay wherever they are.
    delay = np.round(np.where(missing, latest, answered) - ends[events.start], DECIMALS)
    delay = np.maximum(delay, -TOLERANCE)
    near = np.searchsorted(end, own_begin - reach)
    early, over = np.append(begin, np.inf)[near] > own_begin + reach, np.append(first, 0)[near] >= own_stop
    return Answers(delay, missing, early | over)


#: Rows of the sums of each run.
ROWS = (
    "events",
    "delay",
    "squared_delay",
    "missing",
    "false",
    "hours",
    "squared_error",
    "errors",
    "wrong_lead",
    "leads",
    "squared_braking",
    "braking",
)


class Times(NamedTuple):
    """When a function is active, each ``(N,)``."""

    run: Indices
    start: Array
    """s, as ``stop``."""
    stop: Array
    object: Indices
    """Column of the object of the truth at the start; -1 where there is none."""

    @classmethod
    def of(cls, spans: Spans, time: Array, object: Indices) -> Times:
        """Of spans at times ``(instants,)`` s, with the objects ``(instants, runs)``."""
        ends = np.append(time, time[-1])
        return cls(spans.run, ends[spans.start], ends[spans.stop], object[spans.start, spans.run])

    @classmethod
    def joined(cls, blocks: Sequence[Times], runs: Sequence[int]) -> Times:
        """Of blocks of so many runs, with the runs of all numbered."""
        firsts = np.cumsum([0, *runs[:-1]])
        numbered = [block._replace(run=block.run + first) for block, first in zip(blocks, firsts, strict=True)]
        return cls(*map(np.concatenate, zip(*numbered, strict=True)))


class FunctionScores(NamedTuple):
    """The sums of some runs, and every event."""

    sums: Array
    """``(rows, runs)`` as ``ROWS``."""
    delay: Array
    """``(events,)`` s, in the order of runs."""
    missing: Mask
    """``(events,)``"""
    events: Times
    """On the truth."""
    false: Times
    """On the tracks, without an event."""

    def of(self, row: str) -> Array:
        """``(runs,)``"""
        return np.asarray(self.sums[ROWS.index(row)])


class Decisions(NamedTuple):
    """What a function decides at some instants on the truth and on tracks, each ``(instants, runs)``."""

    truth: Decision
    tracks: Decision
    """With the object of the truth in the place of the chosen track's column; -1 where that is on none."""
    chose: Mask
    """Whether it chose a track."""
    overlap: Mask
    """Whether an object of the truth overlaps the ego."""

    @property
    def driving(self) -> Mask:
        """``(instants, runs)`` before the first overlap."""
        return ~np.logical_or.accumulate(self.overlap, axis=0)


class FunctionSums:
    """The accumulator of one function, whose sums its metrics share; with known and with hidden identities.

    Decisions count over the whole drive, from the first instant: a track that starts late warns late.
    """

    def __init__(self, label: str, function: Function) -> None:
        self.name = f"function {label}"
        self.function = function

    def init(self, scope: Scope) -> list[Any]:
        """The bodies and times of a block with known identities; then what was decided."""
        return [scope] if scope.target is not None else []

    def update(self, sums: list[Any], chunk: Chunk | TrackedRun) -> list[Any]:
        if isinstance(chunk, Chunk):
            sums.append(decisions_of_chunk(self.function, chunk, sums[0]))
        else:
            sums.append(score_decisions(decisions_of_run(self.function, chunk), chunk.truth.time, self.function))
        return sums

    def close(self, sums: list[Any]) -> FunctionScores:
        if not isinstance(sums[0], Scope):
            return self.merge(sums)
        scope, *chunks = sums
        whole = _joined(chunks, scope.runs)
        return score_decisions(whole, scope.labelled.time[: len(whole.overlap)], self.function)

    def merge(self, blocks: Sequence[FunctionScores]) -> FunctionScores:
        sums, delay, missing, events, false = zip(*blocks, strict=True)
        runs = [part.shape[1] for part in sums]
        return FunctionScores(
            np.concatenate(sums, axis=1),
            np.concatenate(delay),
            np.concatenate(missing),
            Times.joined(events, runs),
            Times.joined(false, runs),
        )


def decisions_of_chunk(function: Function, chunk: Chunk, scope: Scope) -> Decisions:
    """With known identities: the column of a track is that of its object."""
    bodies = scope.bodies
    assert bodies is not None
    alive = scope.labelled.alive[chunk.instants].T[..., None]
    truth = np.moveaxis(chunk.truth, 1, 2)
    # (..., instants, objects * runs) to (..., objects, instants, runs).
    of_runs = (values.reshape(*values.shape[:-1], -1, chunk.runs) for values in (chunk.mean, chunk.covariance))
    mean, covariance = (np.moveaxis(values, -2, -3) for values in of_runs)
    estimated = chunk.given.reshape(len(chunk.given), -1, chunk.runs).swapaxes(0, 1)
    return decisions_of_estimates(function, bodies.within(chunk.instants), truth, alive, mean, covariance, estimated)


def decisions_of_estimates(
    function: Function, bodies: EgoScene, truth: Array, alive: Mask, mean: Array, covariance: Array, estimated: Mask
) -> Decisions:
    """With known identities, of estimates of every object.

    Args:
        function: the function.
        bodies: at the instants.
        truth: ``(4, objects, instants, runs or 1)`` px, py, vx, vy.
        alive: ``(objects, instants, 1)`` where an object is there.
        mean: ``(4, objects, instants, runs)`` of the estimates.
        covariance: ``(4, 4, objects, instants, runs)``.
        estimated: ``(objects, instants, runs)`` where there is an estimate.
    """
    length, width = bodies.length[:, None, None], bodies.width[:, None, None]
    objects, overlap = _truth(truth, alive, bodies)
    there = estimated & alive
    tracks = Objects(np.where(there, mean, 0.0), np.where(there, covariance, 0.0), there, length, width)
    ego = bodies.ego.each((slice(None), None))
    decided = function.decide(ego, tracks)
    return Decisions(function.decide(ego, objects), decided, decided.object != NO_OBJECT, overlap)


def decisions_of_run(function: Function, run: TrackedRun) -> Decisions:
    """With hidden identities: a track has the size of the object that it is on, or the nominal one."""
    truth, tracks, bodies = run.truth, run.tracks, run.bodies
    assert bodies is not None
    objects, overlap = _truth(truth.state.transpose(0, 2, 1)[..., None], (truth.status > 0).T[..., None], bodies)
    on = run.scores.object_of(tracks.ids.shape)
    length, width = (
        np.where(on == NO_OBJECT, nominal, np.append(sizes, 0.0)[on]).T[..., None]
        for sizes, nominal in zip((bodies.length, bodies.width), NOMINAL_SIZE, strict=True)
    )
    there = (tracks.ids >= 0).T[..., None]
    mean, covariance = np.swapaxes(tracks.mean, -1, -2)[..., None], np.swapaxes(tracks.covariance, -1, -2)[..., None]
    own = Objects(np.where(there, mean, 0.0), np.where(there, covariance, 0.0), there, length, width)
    ego = bodies.ego.each((slice(None), None))
    decided = function.decide(ego, own)
    chose = decided.object != NO_OBJECT
    column = np.where(chose, decided.object, 0)
    chosen = np.take_along_axis(on, column, axis=1) if on.shape[1] else column
    decided = decided._replace(object=np.where(chose, chosen, NO_OBJECT))
    return Decisions(function.decide(ego, objects), decided, chose, overlap)


def _truth(state: Array, there: Mask, bodies: EgoScene) -> tuple[Objects, Mask]:
    """The objects of the truth ``(4, objects, instants, runs or 1)`` and where one overlaps the ego ``(instants,
    runs or 1)``."""
    length, width = bodies.length[:, None, None], bodies.width[:, None, None]
    objects = Objects(state, np.zeros((4, *state.shape)), there, length, width)
    place = on_path(bodies.ego.each((slice(None), None)), objects)
    touches = there & (np.abs(place.along) < place.lengths) & (np.abs(place.across) < place.widths)
    return objects, np.asarray(touches.any(axis=0))


def _joined(chunks: Sequence[Decisions], runs: int) -> Decisions:
    """Successive instants together, each ``(instants, runs)``."""

    def every(parts: Sequence[Any]) -> Any:
        return np.concatenate([np.broadcast_to(part, (len(part), runs)) for part in parts])

    truth, tracks, chose, overlap = zip(*chunks, strict=True)
    truth, tracks = (Decision(*map(every, zip(*parts, strict=True))) for parts in (truth, tracks))
    return Decisions(truth, tracks, every(chose), every(overlap))


def score_decisions(decisions: Decisions, time: Array, function: Function) -> FunctionScores:
    """The sums of each run from all its decisions, at times ``(instants,)`` s.

    A drive ends at the first impact, where an object of the truth overlaps the ego: nothing counts from there on. So a
    warning that is still missing then is late by the time to the impact.
    """
    driving = decisions.driving
    truth, tracks = (while_driving(item, driving) for item in (decisions.truth, decisions.tracks))
    chose = decisions.chose & driving
    runs = driving.shape[1]
    last = np.minimum(driving.sum(axis=0), len(time) - 1)
    events, own = spans(truth.active, time), spans(tracks.active, time)
    impact = np.where(driving.all(axis=0), np.inf, time[last])
    result = match_events(events, own, time, impact)

    def by_run(run: Indices, values: Array | None = None) -> Array:
        return np.bincount(run, values, runs).astype(float)

    begins = _first_moments(events.run, events.start, events.stop, time, runs)
    error = np.where(begins, tracks.quantity - truth.quantity, np.nan)
    has_lead = chose | (truth.object != NO_OBJECT)
    right_lead = (truth.object != NO_OBJECT) & (tracks.object == truth.object)
    acts = tracks.active | truth.active
    commanded, required = (np.where(item.active, item.quantity, 0.0) for item in (tracks, truth))
    nothing = np.zeros(runs)
    sums = {
        "events": by_run(events.run),
        "delay": by_run(events.run, result.delay),
        "squared_delay": by_run(events.run, result.delay**2),
        "missing": by_run(events.run, result.missing.astype(float)),
        "false": by_run(own.run[result.false]),
        "hours": (time[last] - time[0]) / 3600,
        "squared_error": np.nansum(error**2, axis=0),
        "errors": np.isfinite(error).sum(axis=0),
        "wrong_lead": (has_lead & ~right_lead).sum(axis=0) if function.chooses_lead else nothing,
        "leads": has_lead.sum(axis=0) if function.chooses_lead else nothing,
        "squared_braking": ((commanded - required) ** 2).sum(axis=0, where=acts) if function.brakes else nothing,
        "braking": acts.sum(axis=0) if function.brakes else nothing,
    }
    own = Spans(*(part[result.false] for part in own))
    return FunctionScores(
        np.stack([sums[name] for name in ROWS]).astype(float),
        result.delay,
        result.missing,
        Times.of(events, time, truth.object),
        Times.of(own, time, tracks.object),
    )


def while_driving(decision: Decision, driving: Mask) -> Decision:
    """Of ``(instants, runs)``, with nothing decided where it is not driven."""
    active, chosen, quantity = decision
    return Decision(active & driving, np.where(driving, chosen, NO_OBJECT), np.where(driving, quantity, np.nan))


def _first_moments(run: Indices, start: Indices, stop: Indices, time: Array, runs: int) -> Mask:
    """``(instants, runs)`` the first ``TOLERANCE`` of each event."""
    until = np.minimum(np.searchsorted(time, time[start] + TOLERANCE), stop)
    change = np.zeros((len(time) + 1, runs), dtype=int)
    np.add.at(change, (start, run), 1)
    np.add.at(change, (until, run), -1)
    return np.cumsum(change, axis=0)[:-1] > 0
