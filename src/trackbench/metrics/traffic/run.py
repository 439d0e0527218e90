"""Scores of the tracks of one run: GOSPA, T-GOSPA, CLEAR, HOTA, IDF1, events and errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.ego import EgoScene
from trackbench.metrics.traffic.assignment import (
    Associations,
    Counted,
    Nearby,
    NearPairs,
    TrackHistory,
    TrafficScoreOptions,
    TruthHistory,
    count_by_gospa,
    excuse_tracks,
    nearby,
    similarity,
)
from trackbench.metrics.traffic.events import TrafficEvent, events, strips
from trackbench.metrics.traffic.mot_metrics import (
    clear_matches,
    hota,
    identity,
    switches,
    track_of_each,
)
from trackbench.metrics.traffic.set_distances import GospaParts, gospa
from trackbench.metrics.traffic.table import DETECTION_METRICS, OF_FALSE_TRACKS, TRACK_METRICS
from trackbench.metrics.traffic.tgospa import tgospa
from trackbench.metrics.traffic.track_quality import (
    RunSums,
    association_counts,
    confirmation,
    durations,
    false_tracks,
    lost,
    matched_errors,
    never_confirmed,
)

#: Similarity from which on CLEAR and IDF1 take a track to be on an object: at half of the cutoff.
LEAST_SIMILARITY = 0.5
#: Share of the squared GOSPA below which the excess of the squared T-GOSPA is rounding.
ROUNDING = 1e-12


class RunScores(NamedTuple):
    """Scores of the tracks of one run: metrics, GOSPA at each instant, events, and which objects are tracked when."""

    values: RunSums
    """Total and number of terms of each metric, by dotted path. A metric without a value in the run is left out.
    ``confirm_latency``: total of all waiting times, also of waits in vain; count of the objects that get a track."""
    gospa: GospaParts
    """Parts of squared GOSPA at each instant, ``(T,)`` m^2."""
    events: tuple[TrafficEvent, ...]
    """Births, confirmations, losses, switches and other events of the run in the order of time."""
    strips: npt.NDArray[np.int8]
    """``(T, N)`` state of each object at each instant, such as waiting, tracked or lost."""
    until: tuple[RunSums, ...] = ()
    """Values, as in ``values``, from the start of the run up to the end of each stretch of time; empty where the run is
    not cut."""
    on: Sequence[NearPairs] = ()
    """Pairs of a track and the object that the track is on, due or optional."""

    def without_false_tracks(self) -> RunScores:
        """Return the scores without metrics of false tracks, for a ground truth that lacks some real objects."""
        values, *until = (
            {path: sums for path, sums in each.items() if path not in OF_FALSE_TRACKS}
            for each in (self.values, *self.until)
        )
        return self._replace(values=values, until=tuple(until))

    def object_of(self, shape: tuple[int, ...]) -> Indices:
        """Return the number of the object that the track in each column is on, ``(T, K)``; -1 for none."""
        object_of = np.full(shape, -1)
        for pairs in self.on:
            object_of[pairs.instant, pairs.column] = pairs.object
        return object_of


class TrackedRun(NamedTuple):
    """Truth, tracks and scores of a run, or stretch of a run, for a metric of tracks; arrays must not be changed."""

    truth: TruthHistory
    tracks: TrackHistory
    associations: Associations | None
    """Detections that the tracks took; None where the tracker does not say."""
    scores: RunScores
    """Scores that the built-in metrics are computed from."""
    unscored: Mask | None = None
    """``(T, K)`` where a track is in a place that is not scored: outside a region, out of range, or on a don't-care
    box."""
    bodies: EgoScene | None = None
    """Motion of the vehicle that carries the sensors, and sizes of the objects."""
    seconds: float = 0.0
    """Computing time of the tracker in the run, s; each stretch of a run has an equal share."""
    steps: float = 0.0
    """Number of scans that the computing time was spent on; each stretch of a run has an equal share."""


def score_run(
    truth: TruthHistory,
    tracks: TrackHistory,
    options: TrafficScoreOptions | None = None,
    associations: Associations | None = None,
    unscored: Mask | None = None,
    ends: Sequence[int] = (),
) -> RunScores:
    """Return the scores of the tracks of a run: sum and number of terms of each metric, GOSPA, events, object states.

    Args:
        truth: true states of the objects.
        tracks: tracks that the tracker gave.
        options: criteria by which a track is scored.
        associations: the detections that the tracks took; None where the tracker does not say.
        unscored: ``(T, K)`` tracks in places that are not scored.
        ends: indices of instants; the metrics from the start of the run up to each of these instants are added as
            ``until``.
    """
    options = options or TrafficScoreOptions()
    near = nearby(truth, tracks, options.cutoff, unscored)
    of_gospa, counted = count_by_gospa(near), count_by_clear(near)
    duration, steps = durations(truth.time), len(truth.time)
    switch = options.switch(float(duration.mean()))

    def until(end: int) -> RunSums:
        span = slice(0, end)
        pairs = of_gospa.until(end), counted.until(end)
        taken = associations and associations.within(span)
        return _run_sums(truth.within(span), tracks.within(span), *pairs, taken, duration[span], switch)

    whole = until(steps)
    track_of = track_of_each(counted.matched, counted.due.shape)
    changes = switches(track_of)
    return RunScores(
        values=whole,
        gospa=gospa(of_gospa),
        events=events(truth, tracks, counted, of_gospa, track_of, changes, switch),
        strips=strips(track_of, counted.due, changes),
        on=(counted.matched, counted.excused),
        until=tuple(whole if end == steps else until(end) for end in ends),
    )


def _run_sums(
    truth: TruthHistory,
    tracks: TrackHistory,
    of_gospa: Counted,
    counted: Counted,
    associations: Associations | None,
    duration: Array,
    switch: float,
) -> RunSums:
    matched = counted.matched
    track_of = track_of_each(matched, counted.due.shape)
    parts, trajectory = gospa(of_gospa), tgospa(of_gospa, switch)
    steps, squared_gospa = float(len(truth.time)), float(parts.total.sum())
    objects, present = counted.object_counts, counted.track_counts
    of_switches = trajectory.total - squared_gospa
    due, true, switched = float(counted.due.sum()), float(len(matched.instant)), float(len(switches(track_of).instant))
    false = float(counted.present.sum()) - true
    object_minutes = float((duration @ counted.due).sum()) / 60
    alike = similarity(counted.pairs.distance, counted.cutoff)
    higher_order = hota(counted.pairs, alike, objects, present)
    any_there = float(objects.sum() + present.sum() > 0)
    identified, unidentified, wrong = identity(counted.pairs.where(alike >= LEAST_SIMILARITY), objects, present)
    values: RunSums = {
        "tgospa": (trajectory.total, steps),
        "gospa": (squared_gospa, steps),
        "gospa_localisation": (float(parts.localisation.sum()), steps),
        "gospa_missed": (float(parts.missed.sum()), steps),
        "gospa_false": (float(parts.false.sum()), steps),
        "gospa_switch": (0.0 if of_switches < ROUNDING * squared_gospa else of_switches, steps),
        "hota": (float(higher_order.hota.mean()), any_there),
        "deta": (float(higher_order.detection.mean()), any_there),
        "assa": (float(higher_order.association.mean()), any_there),
        "idf1": (2.0 * identified, 2.0 * identified + unidentified + wrong),
        "mota": (true - false - switched, due),
        "matched_share": (true, due),
        "id_switches": (switched, object_minutes),
        "false_tracks": (float(len(false_tracks(counted))), float(duration.sum()) / 60),
        "confirm_latency": confirmation(track_of, counted.due, duration),
        "never_confirmed": never_confirmed(track_of, counted.due),
        "lost_time_share": lost(track_of, counted.due),
        **matched_errors(truth, tracks, matched),
        **({} if associations is None else association_counts(counted, associations)),
    }
    return {path: sums for path, sums in values.items() if any(sums)}


def count_by_clear(near: Nearby) -> Counted:
    """Match due objects and tracks as in CLEAR within half of the cutoff, and return the scored objects and tracks."""
    alike = similarity(near.pairs.distance, near.cutoff)
    on = alike >= LEAST_SIMILARITY
    chosen = on.copy()
    chosen[on] = clear_matches(near.pairs.where(on), alike[on], near.due, near.there)
    return excuse_tracks(near, chosen, LEAST_SIMILARITY * near.cutoff)


METRICS = TRACK_METRICS | DETECTION_METRICS


def in_stretches(run: TrackedRun, ends: Sequence[int]) -> list[TrackedRun]:
    """Cut a run into stretches that end before the instants ``ends``; the stretches' sums add up to the run's sums.

    The sums of a stretch are the sums of the run up to its end less those up to its start. So a switch between two
    stretches counts once, and a track that goes on is the same track. If a later stretch lowers a sum, such as the
    number of objects that are never tracked, earlier stretches do not count the excess. For a metric with one value in
    a run, the value up to an instant is weighted by the time up to it.

    Args:
        run: run with the values ``until`` each of the ends.
        ends: indices of instants, the last of them the number of instants.
    """
    added = {path: _added(path, run.scores.until, np.array(ends) / ends[-1]) for path in run.scores.values}
    parts, starts = [], [0, *ends[:-1]]
    for number, span in enumerate(map(slice, starts, ends)):
        scores = run.scores._replace(
            values={path: (float(sums[0, number]), float(sums[1, number])) for path, sums in added.items()},
            gospa=GospaParts(*(part[span] for part in run.scores.gospa)),
            events=tuple(
                event._replace(instant=event.instant - span.start)
                for event in run.scores.events
                if span.start <= event.instant < span.stop
            ),
            strips=run.scores.strips[span],
            on=[pairs.within(span) for pairs in run.scores.on],
        )
        taken, outside = run.associations and run.associations.within(span), run.unscored
        outside = None if outside is None else outside[span]
        bodies = run.bodies and run.bodies.within(span)
        spent = run.seconds / len(ends), run.steps / len(ends)
        parts.append(
            TrackedRun(run.truth.within(span), run.tracks.within(span), taken, scores, outside, bodies, *spent)
        )
    return parts


def _added(path: str, until: Sequence[RunSums], share: Array) -> Array:
    """Return what each stretch adds to a metric's sum and number of terms, ``(2, stretches)``.

    ``share`` is the share of the run's time up to the end of each stretch.
    """
    sums = np.array([values.get(path, (0.0, 0.0)) for values in until]).T
    metric = METRICS[path]
    if metric.combine == "mean":
        sums *= share
    elif metric.at_least == 0:
        sums[0] = np.minimum.accumulate(sums[0, ::-1])[::-1]
    return np.diff(sums, prepend=0.0)
