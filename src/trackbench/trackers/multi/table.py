"""The tracks of all runs side by side, and what their filter makes of detections."""

from __future__ import annotations

from functools import partial
from operator import methodcaller
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Gaussian, Indices, Mask, Scan, Tracks, with_sensor_of
from trackbench.filters import (
    AnyBelief,
    Filter,
    Measured,
    PredictedMeasurement,
    compact,
    concatenated,
    select,
    selected_prediction,
    with_members,
)
from trackbench.models.motion import MotionModel
from trackbench.trackers.initial import InitialConfig, first_measurement
from trackbench.trackers.multi.gate import in_field_of_view
from trackbench.trackers.multi.mixture import of_pairs

#: The id of a track that is not confirmed, and what stands for "none" wherever an index is expected.
NONE = -1


class TrackTable(NamedTuple):
    """The L tracks of all runs, those of a run in the order in which they began."""

    run: Indices
    """``(L,)``"""
    id: Indices
    """``(L,)`` counts up from 0 within a run as tracks are confirmed; -1 before."""
    belief: AnyBelief
    """Of L members, with nothing that the filter could reuse."""
    seen: Array
    """``(L,)`` time of the latest detection, s."""
    evidence: Array
    """``(k, L)`` what speaks for each track; ``management`` knows what it means."""
    used: Indices
    """``(L,)`` the column that it took in from the latest scan; -1 for none."""
    origin: Indices
    """``(L,)`` number of the object that started it, where the tracker is told; else -1."""

    def select(self, which: Mask | Indices) -> TrackTable:
        """Some of the tracks."""
        index = which.nonzero()[0] if which.dtype == bool else which
        run, id, belief, *rest = self
        parts = map(methodcaller("take", index, -1), (run, id, *rest))
        return TrackTable(next(parts), next(parts), select(belief, index), *parts)


def empty(filter: Filter[Any], evidence: int) -> TrackTable:
    """No tracks, of so many components of the evidence."""
    none = np.zeros(0, dtype=np.intp)

    def nothing(motion: MotionModel) -> Gaussian:
        size = len(motion.components)
        return Gaussian(np.zeros((size, 0)), np.zeros((size, size, 0)))

    return TrackTable(none, none, filter.begin(nothing), np.zeros(0), np.zeros((evidence, 0)), none, none)


def succeeded(table: TrackTable, kept: Mask, more: TrackTable | None) -> TrackTable:
    """The tracks that are kept, ``(L,)``, and ``more`` behind the others."""
    table = table if kept.all() else table.select(kept)
    if more is None:
        return table
    run, id, belief, *rest = table
    pairs = zip((run, id, *rest), (*more[:2], *more[3:]), strict=True)
    parts = map(partial(np.concatenate, axis=-1), pairs)
    return TrackTable(next(parts), next(parts), concatenated(belief, more.belief), *parts)


def by_run(which: Indices, run: Indices) -> Indices:
    """Some tracks, those of a run together, each run's as they were; ``run``: of all tracks."""
    own = run.take(which)
    return which if (own[1:] >= own[:-1]).all() else which[own.argsort(kind="stable")]


def rank_in_run(run: Indices, runs: int) -> Indices:
    """The how-manieth of its run each is, of ascending runs ``(...)``."""
    counts = np.bincount(run, minlength=runs)
    return np.arange(len(run)) - (np.cumsum(counts) - counts)[run]


def numbered(table: TrackTable, deserving: Mask, next_id: Indices) -> tuple[TrackTable, Indices]:
    """The table with ids for those of the deserving that have none yet, and the next id of each run ``(runs,)``."""
    fresh = (deserving & (table.id == NONE)).nonzero()[0]
    if not len(fresh):
        return table, next_id
    fresh = by_run(fresh, table.run)
    run, ids = table.run[fresh], table.id.copy()
    ids[fresh] = next_id[run] + rank_in_run(run, len(next_id))
    return table._replace(id=ids), next_id + np.bincount(run, minlength=len(next_id))


def reported_tracks(
    table: TrackTable, filter: Filter[Any], existence: Array | None, runs: int, least_existence: float = 0.0
) -> Tracks:
    """Return the confirmed tracks of sufficient existence as arrays with a last axis of runs, padded.

    Args:
        table: of all tracks.
        filter: of their beliefs.
        existence: ``(L,)``, if the tracker has it.
        runs: how many.
        least_existence: of a track that is reported.
    """
    told = table.id != NONE
    which = (told if existence is None else told & (existence >= least_existence)).nonzero()[0]
    shape, missing = (len(which), 1), None
    if runs > 1:
        which = by_run(which, table.run)
        counts = np.bincount(table.run[which], minlength=runs)
        shape = (int(counts.max(initial=0)), runs)
        place = np.zeros((runs, shape[0]), dtype=np.intp)
        is_there = np.arange(shape[0]) < counts[:, None]
        place[is_there] = which
        which = place.T.reshape(-1)
        missing = (~is_there.T).ravel().nonzero()[0]

    def padded(values: Any) -> Any:
        if missing is not None:
            values[..., missing] = NONE if values.dtype.kind == "i" else np.nan
        return values.reshape(*values.shape[:-1], *shape)

    mean, covariance = map(padded, filter.cartesian(select(table.belief, which)))
    probability = None if existence is None else padded(existence.take(which))
    return Tracks(padded(table.id.take(which)), mean, covariance, probability, padded(table.used.take(which)))


class PredictedTracks(NamedTuple):
    """Tracks at the time of a scan, and what they expect of it."""

    belief: AnyBelief
    """With what the filter can reuse for its update."""
    measurement: PredictedMeasurement
    in_view: Mask
    """``(...)`` which are in the field of view of the sensor."""


class TrackFilter:
    """A filter on the beliefs of the L tracks that take in the N detections of a scan."""

    def __init__(self, filter: Filter[Any], initial: InitialConfig) -> None:
        self.filter = filter
        self.initial = initial

    def measured(self, scan: Scan) -> Measured:
        """The detections in the space in which the filter compares them with its predictions."""
        return self.filter.measured(scan)

    def begin(self, scan: Scan) -> AnyBelief:
        """Of N tracks: what each detection says by itself."""
        return begun(self.filter, self.initial, scan)

    def expect(self, belief: AnyBelief, dt: float, scan: Scan) -> PredictedTracks:
        """What is expected of a scan ``dt`` seconds later, at whose detections it does not look."""
        return expected(self.filter, self.filter.predict(belief, dt), scan)

    def after(self, at: PredictedTracks, scan: Scan, track: Indices, detection: Indices) -> AnyBelief:
        """Of P members: the belief of a track after the detection that stands beside it.

        Args:
            at: of the L tracks.
            scan: of N detections, all valid.
            track, detection: ``(P,)``
        """
        predicted = selected_prediction(at.measurement, track)
        part = at._replace(belief=select(at.belief, track), measurement=predicted)
        return self._updated(part, selected_detections(scan, detection))

    def _updated(self, at: PredictedTracks, scan: Scan) -> AnyBelief:
        result: AnyBelief = self.filter.update(at.belief, scan, at.measurement).belief
        return result

    def taken_in(self, at: PredictedTracks, scan: Scan, detection: Indices) -> AnyBelief:
        """Of the L tracks: the belief after the detection ``(L,)`` of each; as it was where that is negative."""
        belief, track = compact(at.belief), np.flatnonzero(detection >= 0)
        return with_members(belief, track, self.after(at, scan, track, detection[track])) if len(track) else belief

    def mixture(
        self, at: PredictedTracks, scan: Scan, track: Indices, detection: Indices, share: Array, kept: Array
    ) -> AnyBelief:
        """Of the L tracks: the mixture of their prediction and of their update with each of their detections.

        Args:
            at: of the L tracks.
            scan: of N detections, all valid.
            track, detection: ``(P,)``, sorted by track.
            share: ``(P,)`` the probability of each detection.
            kept: ``(L,)`` the probability of none.
        """
        before = compact(at.belief)
        if not len(track):
            return before
        return of_pairs(self.filter.motions, before, self.after(at, scan, track, detection), track, share, kept)


def begun(filter: Filter[Any], initial: InitialConfig, scan: Scan) -> AnyBelief:
    """What each detection of a scan says by itself."""
    result: AnyBelief = filter.begin(lambda motion: first_measurement(motion, initial, scan))
    return result


def expected(filter: Filter[Any], belief: AnyBelief, scan: Scan) -> PredictedTracks:
    """What a belief at the time of a scan expects of it."""
    seen = in_field_of_view(filter.cartesian(belief).mean[:2], scan)
    return PredictedTracks(belief, filter.predict_measurement(belief, scan), seen)


def selected_detections(scan: Scan, which: Indices, valid: Mask | None = None) -> Scan:
    """Some detections of a scan, or the same one several times; ``valid``: which of them are to count, unless all."""
    noise = scan.noise_covariance if scan.noise_covariance.ndim == 2 else scan.noise_covariance.take(which, axis=-1)
    values = {"measurement": scan.measurement.take(which, axis=1), "noise_covariance": noise}
    return with_sensor_of(scan, which, valid=scan.valid.take(which) if valid is None else valid, **values)
