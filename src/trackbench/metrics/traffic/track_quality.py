"""Latency, continuity and accuracy of tracks: how soon, how long and how well objects are tracked."""

from __future__ import annotations

import numpy as np

from trackbench.base.linalg import cholesky, symmetrise
from trackbench.base.types import FALSE_ALARM, Array, Indices, Mask
from trackbench.metrics.consistency import point95
from trackbench.metrics.traffic.assignment import (
    NO_DETECTION,
    Associations,
    Counted,
    NearPairs,
    TrackHistory,
    TruthHistory,
    last_instant_before,
)
from trackbench.metrics.traffic.mot_metrics import NO_TRACK, object_of_each

#: Total and number of the terms of each metric in a run, by path.
RunSums = dict[str, tuple[float, float]]


def durations(time: Array) -> Array:
    """Return the time from each instant to the next, ``(T,)`` s; the last gets the mean of the others (0 if alone)."""
    steps = np.diff(time)
    return np.append(steps, steps.mean() if len(steps) else 0.0)


def never_confirmed(track_of: Indices, due: Mask) -> tuple[float, float]:
    """Return the number of due objects that never get a track, and the number of all due objects."""
    ever_due, ever_tracked = due.any(axis=0), (track_of != NO_TRACK).any(axis=0)
    return float((ever_due & ~ever_tracked).sum()), float(ever_due.sum())


def confirmation(track_of: Indices, due: Mask, duration: Array) -> tuple[float, float]:
    """Return the total time, s, that due objects wait for their first track, and the number of objects with a track.

    The quotient is the mean time to an event that the run can end before: the maximum-likelihood estimate for a
    constant rate. Source: Lawless (2003), "Statistical Models and Methods for Lifetime Data", section 4.1 (total time
    on test over number of failures).
    """
    tracked = due.any(axis=0) & (track_of != NO_TRACK).any(axis=0)
    waiting = due & ~np.logical_or.accumulate(track_of != NO_TRACK, axis=0)
    return float((duration @ waiting).sum()), float(tracked.sum())


def lost(track_of: Indices, due: Mask) -> tuple[float, float]:
    """Return two numbers of due instants from each object's first track on: instants without a track, and all."""
    tracked = track_of != NO_TRACK
    since = due & np.logical_or.accumulate(tracked, axis=0)
    return float((since & ~tracked).sum()), float(since.sum())


def false_tracks(counted: Counted) -> Indices:
    """Return the numbers of the tracks that are scored at some time and never on an object, due or optional."""
    real = counted.track_counts == 0
    real[counted.matched.track] = True
    real[counted.excused.track] = True
    return np.flatnonzero(~real)


def matched_errors(truth: TruthHistory, tracks: TrackHistory, matched: NearPairs) -> RunSums:
    """Return sum and number of terms, over matched pairs, of squared errors, m^2 and (m/s)^2, and NEES, by metric path.

    The share of NEES up to the 95 % point has its own path.

    Errors are estimate minus truth, in the fixed frame. Values that are not finite do not count, such as the velocity
    of tracks without one, nor do covariances that are not positive definite.

    Source: Bar-Shalom, Li and Kirubarajan (2001), "Estimation with Applications to Tracking and Navigation", section
    5.4.2.
    """
    true = truth.at(matched.instant, matched.object, matched.column)
    error = tracks.mean[:, matched.instant, matched.column] - true
    factor = cholesky(symmetrise(tracks.covariance[:, :, matched.instant, matched.column]))
    squares = error**2
    nees = (factor.whiten(error) ** 2).sum(axis=0)[factor.positive]
    inside = np.where(np.isfinite(nees), nees <= point95(4), np.nan)
    return {
        "position_rmse": _finite_sum(squares[:2].sum(axis=0)),
        "velocity_rmse": _finite_sum(squares[2:].sum(axis=0)),
        "nees": _finite_sum(nees),
        "nees_inside": _finite_sum(inside),
    }


def _finite_sum(values: Array) -> tuple[float, float]:
    finite = values[np.isfinite(values)]
    return float(finite.sum()), float(len(finite))


def association_counts(counted: Counted, taken: Associations) -> RunSums:
    """Return count and total of the associations of tracks on due objects, by outcome: right, wrong, clutter, missed.

    A scan counts for a track that took a detection, or whose object was detected and missed.

    A track's own object is the object that the track was last matched with at an earlier instant, else at the instant
    of the scan. So the scan itself does not decide which object is the track's own.
    """
    number = np.minimum(np.searchsorted(counted.ids, taken.ids), max(len(counted.ids) - 1, 0))
    counts = counted.ids[number] == taken.ids if len(counted.ids) else np.zeros(taken.ids.shape, dtype=bool)
    scan, column = np.nonzero(counts)
    # (T, tracks), -1 where a track has none yet.
    object_of = object_of_each(counted.matched, len(counted.due), len(counted.ids))
    instant, number = taken.instant[scan], number[scan, column]
    before = last_instant_before(object_of >= 0)[instant, number]
    own_object = object_of[np.where(before >= 0, before, instant), number]
    due = (own_object >= 0) & counted.due[instant, own_object]
    scan, column, own_object = scan[due], column[due], own_object[due]
    origin = taken.origin[scan, column]
    right = origin == own_object
    if taken.merged is not None:
        # Two objects may have caused the detection.
        right |= (origin >= 0) & (taken.merged[scan, column] == own_object)
    outcomes = {
        "association_right": right,
        "association_wrong_object": (origin >= 0) & ~right,
        "association_clutter": origin == FALSE_ALARM,
        "association_missed": (origin == NO_DETECTION) & taken.detected[scan, own_object],
    }
    counts = {name: float(outcome.sum()) for name, outcome in outcomes.items()}
    total = sum(counts.values())
    return {name: (count, total) for name, count in counts.items()}
