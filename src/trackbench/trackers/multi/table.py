"""Table of the tracks of all runs, and the filter that updates them with detections."""

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
from trackbench.trackers.multi.mixture import mix_pairs

#: Id of a tentative track, and placeholder for a missing index.
NONE = -1


class TrackTable(NamedTuple):
    """L tracks of all runs side by side; within a run in the order in which they began."""

    run: Indices
    """Run ``(L,)`` of each track, as an index in the batch of runs."""
    id: Indices
    """Number ``(L,)`` of a confirmed track, counted from 0 in each run; -1 for a tentative track."""
    belief: AnyBelief
    """Beliefs of the L tracks, without Cholesky factors and sigma points."""
    seen: Array
    """Time ``(L,)`` of each track's latest detection, s."""
    evidence: Array
    """Evidence ``(k, L)`` on which a rule confirms and deletes tracks; the rule in ``management`` defines its rows."""
    used: Indices
    """Column ``(L,)`` in the latest scan of the detection used for each track; -1 for none."""
    origin: Indices
    """Number ``(L,)`` of the object that started each track, known to the oracle association only; else -1."""

    def select(self, which: Mask | Indices) -> TrackTable:
        """Return the tracks that ``which`` selects, a mask ``(L,)`` or indices."""
        index = which.nonzero()[0] if which.dtype == bool else which
        run, id, belief, *rest = self
        parts = map(methodcaller("take", index, -1), (run, id, *rest))
        return TrackTable(next(parts), next(parts), select(belief, index), *parts)


def empty(filter: Filter[Any], evidence: int) -> TrackTable:
    """Return a table with no tracks, for ``evidence`` rows of evidence."""
    none = np.zeros(0, dtype=np.intp)

    def nothing(motion: MotionModel) -> Gaussian:
        size = len(motion.components)
        return Gaussian(np.zeros((size, 0)), np.zeros((size, size, 0)))

    return TrackTable(none, none, filter.begin(nothing), np.zeros(0), np.zeros((evidence, 0)), none, none)


def with_new_tracks(table: TrackTable, is_kept: Mask, new: TrackTable | None) -> TrackTable:
    """Return the tracks for which ``is_kept`` ``(L,)`` is True, followed by the tracks ``new``; None adds none."""
    table = table if is_kept.all() else table.select(is_kept)
    if new is None:
        return table
    run, id, belief, *rest = table
    pairs = zip((run, id, *rest), (*new[:2], *new[3:]), strict=True)
    parts = map(partial(np.concatenate, axis=-1), pairs)
    return TrackTable(next(parts), next(parts), concatenated(belief, new.belief), *parts)


def sorted_by_run(which: Indices, run: Indices) -> Indices:
    """Sort the track indices ``which`` by run, in unchanged order within a run; ``run`` is the run of every track."""
    selected_run = run.take(which)
    return which if (selected_run[1:] >= selected_run[:-1]).all() else which[selected_run.argsort(kind="stable")]


def rank_in_run(run: Indices, runs: int) -> Indices:
    """Return the position of each entry within its run, for entries in ascending order of ``run`` ``(...)``."""
    counts = np.bincount(run, minlength=runs)
    return np.arange(len(run)) - (np.cumsum(counts) - counts)[run]


def with_ids(table: TrackTable, is_confirmed: Mask, next_id: Indices) -> tuple[TrackTable, Indices]:
    """Give an id to each newly confirmed track; return the table, and the next free id of each run ``(runs,)``."""
    new = (is_confirmed & (table.id == NONE)).nonzero()[0]
    if not len(new):
        return table, next_id
    new = sorted_by_run(new, table.run)
    run, ids = table.run[new], table.id.copy()
    ids[new] = next_id[run] + rank_in_run(run, len(next_id))
    return table._replace(id=ids), next_id + np.bincount(run, minlength=len(next_id))


def reported_tracks(
    table: TrackTable, filter: Filter[Any], existence: Array | None, runs: int, least_existence: float = 0.0
) -> Tracks:
    """Return the confirmed tracks with enough existence, as arrays padded along a last axis of runs.

    Args:
        table: all tracks.
        filter: filter of the tracks.
        existence: existence probability ``(L,)``; None if the tracker computes none.
        runs: number of runs.
        least_existence: least existence probability of a reported track.
    """
    is_confirmed = table.id != NONE
    which = (is_confirmed if existence is None else is_confirmed & (existence >= least_existence)).nonzero()[0]
    shape, missing = (len(which), 1), None
    if runs > 1:
        which = sorted_by_run(which, table.run)
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
    """Tracks predicted to the time of a scan, with their predicted measurements."""

    belief: AnyBelief
    """Predicted beliefs, with factors and sigma points that the update can reuse."""
    measurement: PredictedMeasurement
    in_view: Mask
    """Mask ``(...)``, True for tracks in the field of view of the scan's sensor."""


class TrackFilter:
    """Filter that updates the L tracks with the N detections of a scan."""

    def __init__(self, filter: Filter[Any], initial: InitialConfig) -> None:
        self.filter = filter
        self.initial = initial

    def measured(self, scan: Scan) -> Measured:
        """Return the detections in the space in which the filter compares them with predicted measurements."""
        return self.filter.measured(scan)

    def begin(self, scan: Scan) -> AnyBelief:
        """Return the first beliefs ``(n, N)`` of tracks, one from each detection alone."""
        return first_beliefs(self.filter, self.initial, scan)

    def expect(self, belief: AnyBelief, dt: float, scan: Scan) -> PredictedTracks:
        """Return the tracks predicted to a scan ``dt`` seconds later; the scan's detections are not used."""
        return predicted_tracks(self.filter, self.filter.predict(belief, dt), scan)

    def after(self, tracks: PredictedTracks, scan: Scan, track: Indices, detection: Indices) -> AnyBelief:
        """Return the belief of each pair ``(P,)``: its track updated with its detection."""
        predicted = selected_prediction(tracks.measurement, track)
        part = tracks._replace(belief=select(tracks.belief, track), measurement=predicted)
        return self._updated(part, selected_detections(scan, detection))

    def _updated(self, tracks: PredictedTracks, scan: Scan) -> AnyBelief:
        result: AnyBelief = self.filter.update(tracks.belief, scan, tracks.measurement).belief
        return result

    def updated_tracks(self, tracks: PredictedTracks, scan: Scan, detection: Indices) -> AnyBelief:
        """Return the L tracks, each updated with the detection at its index ``(L,)``; unchanged if it is negative."""
        belief, track = compact(tracks.belief), np.flatnonzero(detection >= 0)
        return with_members(belief, track, self.after(tracks, scan, track, detection[track])) if len(track) else belief

    def mixture(
        self, tracks: PredictedTracks, scan: Scan, track: Indices, detection: Indices, share: Array, missed: Array
    ) -> AnyBelief:
        """Return for each track the mixture of its prediction and of the updates with its possible detections.

        Args:
            tracks: the L predicted tracks.
            scan: scan with N valid detections.
            track: ``(P,)`` track of each pair, ascending.
            detection: ``(P,)`` detection of each pair.
            share: association probability ``(P,)`` of each pair.
            missed: probability ``(L,)`` that a track has no detection.
        """
        before = compact(tracks.belief)
        if not len(track):
            return before
        return mix_pairs(self.filter.motions, before, self.after(tracks, scan, track, detection), track, share, missed)


def first_beliefs(filter: Filter[Any], initial: InitialConfig, scan: Scan) -> AnyBelief:
    """Return the first belief of a track from each detection of a scan alone."""
    result: AnyBelief = filter.begin(lambda motion: first_measurement(motion, initial, scan))
    return result


def predicted_tracks(filter: Filter[Any], belief: AnyBelief, scan: Scan) -> PredictedTracks:
    """Predict the measurements of tracks whose beliefs are already at the time of a scan; return both."""
    in_view = in_field_of_view(filter.cartesian(belief).mean[:2], scan)
    return PredictedTracks(belief, filter.predict_measurement(belief, scan), in_view)


def selected_detections(scan: Scan, which: Indices, valid: Mask | None = None) -> Scan:
    """Return the detections of a scan at the indices ``which``, possibly repeated; ``valid`` replaces their mask."""
    noise = scan.noise_covariance if scan.noise_covariance.ndim == 2 else scan.noise_covariance.take(which, axis=-1)
    values = {"measurement": scan.measurement.take(which, axis=1), "noise_covariance": noise}
    return with_sensor_of(scan, which, valid=scan.valid.take(which) if valid is None else valid, **values)
