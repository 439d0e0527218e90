"""The sums of a function's decisions: which activity on the tracks answers which event on the truth.

An event is an interval in which the function is active on the truth.
"""

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

#: Shortest gap that ends an activity, s, and largest distance of an answer from its event, s.
TOLERANCE = 0.5
#: Decimals to which a delay is rounded, s.
DECIMALS = 9


class Spans(NamedTuple):
    """Intervals ``(N,)`` in which a function is active, sorted by run and time."""

    run: Indices
    start: Indices
    """Index of the first instant of each interval."""
    stop: Indices
    """Index of the first instant after each interval; the number of instants where it lasts to the end."""


def spans(active: Mask, time: Array) -> Spans:
    """Return the intervals of activity ``(instants, runs)`` at times ``(instants,)``, s; short gaps are bridged."""
    padded = np.zeros((active.shape[1], len(active) + 2), dtype=np.int8)
    padded[:, 1:-1] = active.T
    change = np.diff(padded, axis=1)
    (run, start), (_, stop) = np.nonzero(change > 0), np.nonzero(change < 0)
    if not len(run):
        return Spans(run, start, stop)
    # The minimum only matters at the end of a run, which the comparison of runs decides.
    pause = time[start[1:]] - time[np.minimum(stop[:-1], len(time) - 1)]
    apart = (run[1:] != run[:-1]) | (pause >= TOLERANCE - SAME_TIME)
    first, last = np.append(True, apart), np.append(apart, True)
    return Spans(run[first], start[first], stop[last])


class Answers(NamedTuple):
    """Outcome of the events ``(events,)`` on the truth and the intervals ``(N,)`` on a tracker's tracks."""

    delay: Array
    """Time from the start of each event to the start of its answer, s, ``(events,)``; negative if early."""
    missing: Mask
    """Whether each event on the truth has no answer on the tracks, ``(events,)``."""
    false: Mask
    """Whether each interval on the tracks answers no event or begins too early, ``(N,)``."""


def match_events(events: Spans, answers: Spans, time: Array, impact: Array) -> Answers:
    """Match the intervals on a tracker's tracks with the events.

    An interval answers an event if it is active during the event, or begins up to ``TOLERANCE`` after its end; the
    first such interval counts. An interval that lasts since the previous event begins, for the next event, at the end
    of the previous one. An interval is false if it begins near no event, or ends before the event that it is near.

    Args:
        events: intervals on the truth.
        answers: intervals on the tracks.
        time: times of the instants ``(instants,)``, s.
        impact: time of the impact in each run ``(runs,)``, s; infinite without one. A missing answer counts as given
            at the impact, or ``TOLERANCE`` after the end of the event, whichever is earlier.
    """
    reach = TOLERANCE + SAME_TIME
    ends = np.append(time, time[-1])
    # All runs share one time axis, shifted so far that intervals of two runs are never near.
    apart = time[-1] - time[0] + 4 * reach
    begin, end = (ends[at] + events.run * apart for at in (events.start, events.stop))
    answer_begin = ends[answers.start] + answers.run * apart
    # The axis in instants, since an interval may last to the end.
    first, answer_stop = (at + item.run * len(ends) for at, item in ((events.start, events), (answers.stop, answers)))
    candidate = np.searchsorted(answer_stop, first, side="right")
    begins = np.append(answer_begin, np.inf)[candidate]
    missing = begins > end + reach
    # Unshifted times, so that rounding makes no delay.
    answered = np.append(ends[answers.start], 0.0)[candidate]
    going_on = np.append(False, (events.run[1:] == events.run[:-1]) & (begins[1:] < end[:-1]))
    answered = np.where(going_on, np.append(0.0, ends[events.stop[:-1]]), answered)
    latest = np.minimum(ends[events.stop] + TOLERANCE, impact[events.run])
    # Rounded, since times are sums of periods: a number of scans is the same delay everywhere.
    delay = np.round(np.where(missing, latest, answered) - ends[events.start], DECIMALS)
    delay = np.maximum(delay, -TOLERANCE)
    near = np.searchsorted(end, answer_begin - reach)
    early, over = np.append(begin, np.inf)[near] > answer_begin + reach, np.append(first, 0)[near] >= answer_stop
    return Answers(delay, missing, early | over)


#: Names of the rows of the sums of each run.
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
    """Intervals in which a driver assistance function is active: run, start, end and object, each ``(N,)``."""

    run: Indices
    start: Array
    """Start of each interval, s; ``stop`` is the end: the first inactive instant, or the last instant."""
    stop: Array
    object: Indices
    """Index of the true object on which the function acts at the start of each interval; -1 for a false track."""

    @classmethod
    def of(cls, spans: Spans, time: Array, object: Indices) -> Times:
        """Return intervals in seconds from intervals of indices.

        ``time`` ``(instants,)`` is in s; ``object`` ``(instants, runs)`` is the index of the true object, or -1.
        """
        ends = np.append(time, time[-1])
        return cls(spans.run, ends[spans.start], ends[spans.stop], object[spans.start, spans.run])

    @classmethod
    def joined(cls, blocks: Sequence[Times], runs: Sequence[int]) -> Times:
        """Join the intervals of blocks with ``runs`` runs each, and number the runs of all blocks consecutively."""
        firsts = np.cumsum([0, *runs[:-1]])
        numbered = [block._replace(run=block.run + first) for block, first in zip(blocks, firsts, strict=True)]
        return cls(*map(np.concatenate, zip(*numbered, strict=True)))


class FunctionScores(NamedTuple):
    """Scores of a driver assistance function in some runs: sums by run, and every event with its delay."""

    sums: Array
    """Sums in each run, ``(rows, runs)``; ``ROWS`` has the names of the rows."""
    delay: Array
    """Delay of each event, s, ``(events,)``, in the order of runs."""
    missing: Mask
    """Whether each event has no answer on the tracks, ``(events,)``."""
    events: Times
    """Intervals in which the function is active on the truth."""
    false: Times
    """Intervals of activity on the tracks that answer no event."""

    def of(self, row: str) -> Array:
        """Return one row of the sums, ``(runs,)``."""
        return np.asarray(self.sums[ROWS.index(row)])


class Decisions(NamedTuple):
    """Decisions of a function at some instants, on the truth and on tracks, each ``(instants, runs)``."""

    truth: Decision
    tracks: Decision
    """Decisions on the tracks; ``object`` is the index of the chosen track's true object, -1 for a false track."""
    chose: Mask
    """Whether the decision on the tracks is about a track, which can be a false track."""
    overlap: Mask
    """Whether a true object overlaps the ego."""

    @property
    def driving(self) -> Mask:
        """Whether an instant is before the first overlap of the ego with a true object, ``(instants, runs)``."""
        return ~np.logical_or.accumulate(self.overlap, axis=0)


class FunctionSums:
    """Accumulator of one assistance function's decisions, shared by its metrics, for known and hidden identities.

    Decisions count over the whole drive, from the first instant: a track that starts late warns late.
    """

    def __init__(self, label: str, function: Function) -> None:
        self.name = f"function {label}"
        self.function = function

    def init(self, scope: Scope) -> list[Any]:
        """Return a list for decisions; with known identities it begins with the scope, which has bodies and times."""
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
        joined = _join(chunks, scope.runs)
        return score_decisions(joined, scope.labelled.time[: len(joined.overlap)], self.function)

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
    """Return the decisions in some instants with known identities, where track k is the track of object k."""
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
    """Return a function's decisions on the truth and on the estimates, with known identities.

    Args:
        function: driver assistance function.
        bodies: ego and sizes of the objects at the instants.
        truth: true px, py, vx, vy, ``(4, objects, instants, runs or 1)``.
        alive: whether an object is present, ``(objects, instants, 1)``.
        mean: estimates, ``(4, objects, instants, runs)``.
        covariance: covariances of the estimates, ``(4, 4, objects, instants, runs)``.
        estimated: whether there is an estimate, ``(objects, instants, runs)``.
    """
    length, width = bodies.length[:, None, None], bodies.width[:, None, None]
    objects, overlap = _true_objects(truth, alive, bodies)
    there = estimated & alive
    tracks = Objects(np.where(there, mean, 0.0), np.where(there, covariance, 0.0), there, length, width)
    ego = bodies.ego.each((slice(None), None))
    on_tracks = function.decide(ego, tracks)
    return Decisions(function.decide(ego, objects), on_tracks, on_tracks.object != NO_OBJECT, overlap)


def decisions_of_run(function: Function, run: TrackedRun) -> Decisions:
    """Return the decisions with hidden identities; a track has its object's size, a false track the nominal size."""
    truth, tracks, bodies = run.truth, run.tracks, run.bodies
    assert bodies is not None
    objects, overlap = _true_objects(truth.state.transpose(0, 2, 1)[..., None], (truth.status > 0).T[..., None], bodies)
    object_of_track = run.scores.object_of(tracks.ids.shape)
    length, width = (
        np.where(object_of_track == NO_OBJECT, nominal, np.append(sizes, 0.0)[object_of_track]).T[..., None]
        for sizes, nominal in zip((bodies.length, bodies.width), NOMINAL_SIZE, strict=True)
    )
    there = (tracks.ids >= 0).T[..., None]
    mean, covariance = np.swapaxes(tracks.mean, -1, -2)[..., None], np.swapaxes(tracks.covariance, -1, -2)[..., None]
    reported = Objects(np.where(there, mean, 0.0), np.where(there, covariance, 0.0), there, length, width)
    ego = bodies.ego.each((slice(None), None))
    on_tracks = function.decide(ego, reported)
    chose = on_tracks.object != NO_OBJECT
    column = np.where(chose, on_tracks.object, 0)
    chosen = np.take_along_axis(object_of_track, column, axis=1) if object_of_track.shape[1] else column
    on_tracks = on_tracks._replace(object=np.where(chose, chosen, NO_OBJECT))
    return Decisions(function.decide(ego, objects), on_tracks, chose, overlap)


def _true_objects(state: Array, there: Mask, bodies: EgoScene) -> tuple[Objects, Mask]:
    """Return the true objects, and whether a true object overlaps the ego, ``(instants, runs or 1)``."""
    length, width = bodies.length[:, None, None], bodies.width[:, None, None]
    objects = Objects(state, np.zeros((4, *state.shape)), there, length, width)
    positions = on_path(bodies.ego.each((slice(None), None)), objects)
    touches = there & (np.abs(positions.along) < positions.lengths) & (np.abs(positions.across) < positions.widths)
    return objects, np.asarray(touches.any(axis=0))


def _join(chunks: Sequence[Decisions], runs: int) -> Decisions:
    """Join decisions of successive instants, each ``(instants, runs)``."""

    def concatenate(parts: Sequence[Any]) -> Any:
        return np.concatenate([np.broadcast_to(part, (len(part), runs)) for part in parts])

    truth, tracks, chose, overlap = zip(*chunks, strict=True)
    truth, tracks = (Decision(*map(concatenate, zip(*parts, strict=True))) for parts in (truth, tracks))
    return Decisions(truth, tracks, concatenate(chose), concatenate(overlap))


def score_decisions(decisions: Decisions, time: Array, function: Function) -> FunctionScores:
    """Return the sums of each run from all its decisions, at times ``(instants,)``, s.

    A drive ends at the first impact, where a true object overlaps the ego: nothing counts afterwards. A warning that is
    still missing then is late by the time to the impact.
    """
    driving = decisions.driving
    truth, tracks = (while_driving(item, driving) for item in (decisions.truth, decisions.tracks))
    chose = decisions.chose & driving
    runs = driving.shape[1]
    last = np.minimum(driving.sum(axis=0), len(time) - 1)
    events, answers = spans(truth.active, time), spans(tracks.active, time)
    impact = np.where(driving.all(axis=0), np.inf, time[last])
    result = match_events(events, answers, time, impact)

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
        "false": by_run(answers.run[result.false]),
        "hours": (time[last] - time[0]) / 3600,
        "squared_error": np.nansum(error**2, axis=0),
        "errors": np.isfinite(error).sum(axis=0),
        "wrong_lead": (has_lead & ~right_lead).sum(axis=0) if function.chooses_lead else nothing,
        "leads": has_lead.sum(axis=0) if function.chooses_lead else nothing,
        "squared_braking": ((commanded - required) ** 2).sum(axis=0, where=acts) if function.brakes else nothing,
        "braking": acts.sum(axis=0) if function.brakes else nothing,
    }
    false = Spans(*(part[result.false] for part in answers))
    return FunctionScores(
        np.stack([sums[name] for name in ROWS]).astype(float),
        result.delay,
        result.missing,
        Times.of(events, time, truth.object),
        Times.of(false, time, tracks.object),
    )


def while_driving(decision: Decision, driving: Mask) -> Decision:
    """Return a decision ``(instants, runs)`` without activity and object where the drive has ended."""
    active, chosen, quantity = decision
    return Decision(active & driving, np.where(driving, chosen, NO_OBJECT), np.where(driving, quantity, np.nan))


def _first_moments(run: Indices, start: Indices, stop: Indices, time: Array, runs: int) -> Mask:
    """Return a mask ``(instants, runs)`` of the first ``TOLERANCE`` seconds of each event."""
    until = np.minimum(np.searchsorted(time, time[start] + TOLERANCE), stop)
    change = np.zeros((len(time) + 1, runs), dtype=int)
    np.add.at(change, (start, run), 1)
    np.add.at(change, (until, run), -1)
    return np.cumsum(change, axis=0)[:-1] > 0
