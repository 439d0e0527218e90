"""How soon, how long and how accurately objects are tracked."""

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

#: By metric, the total of its terms in a run and their number.
RunSums = dict[str, tuple[float, float]]


def durations(time: Array) -> Array:
    """``(T,)`` s from each instant to the next one; the last has the mean of the others, a single one none."""
    steps = np.diff(time)
    return np.append(steps, steps.mean() if len(steps) else 0.0)


def never_confirmed(track_of: Indices, due: Mask) -> tuple[float, float]:
    """Number of objects that are due and never tracked, and number of objects that are due."""
    ever_due, ever_tracked = due.any(axis=0), (track_of != NO_TRACK).any(axis=0)
    return float((ever_due & ~ever_tracked).sum()), float(ever_due.sum())


def confirmation(track_of: Indices, due: Mask, duration: Array) -> tuple[float, float]:
    """Time that objects were due before their first track, or all of it without one, over the number that got one.

    It is the mean time to an event where it is not always waited for, and the maximum-likelihood estimate for a
    constant rate. Source: Lawless (2003), "Statistical Models and Methods for Lifetime Data", section 4.1 (total time
    on test over number of failures).

    Returns:
        Both apart.
    """
    tracked = due.any(axis=0) & (track_of != NO_TRACK).any(axis=0)
    waiting = due & ~np.logical_or.accumulate(track_of != NO_TRACK, axis=0)
    return float((duration @ waiting).sum()), float(tracked.sum())


def lost(track_of: Indices, due: Mask) -> tuple[float, float]:
    """Due instants without a track after the object's first one, of all due instants from then on."""
    tracked = track_of != NO_TRACK
    since = due & np.logical_or.accumulate(tracked, axis=0)
    return float((since & ~tracked).sum()), float(since.sum())


def false_tracks(counted: Counted) -> Indices:
    """Numbers of the tracks that count at some time and never are on any object, due or optional."""
    real = counted.track_counts == 0
    real[counted.matched.track] = True
    real[counted.excused.track] = True
    return np.flatnonzero(~real)


def matched_errors(truth: TruthHistory, tracks: TrackHistory, matched: NearPairs) -> RunSums:
    """Squared errors of matched pairs, m^2 and (m/s)^2, their normalised estimation error squared, and which of these
    are up to the 95 % quantile of chi-square with 4 degrees of freedom.

    Errors are estimate minus truth, in the fixed frame. What is not finite does not count, such as the velocity of
    tracks without one, nor do covariances that are not positive definite.

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
    """Tracks on due objects, over all scans, in which the track took a detection or its object was detected.

    A track's own object is the one that it was last matched with at an earlier instant, else at that of the scan. What
    the scan itself does to the track so says nothing about which object is its own.
    """
    number = np.minimum(np.searchsorted(counted.ids, taken.ids), max(len(counted.ids) - 1, 0))
    counts = counted.ids[number] == taken.ids if len(counted.ids) else np.zeros(taken.ids.shape, dtype=bool)
    scan, column = np.nonzero(counts)
    # (T, tracks), -1 where a track has none yet.
    object_of = object_of_each(counted.matched, len(counted.due), len(counted.ids))
    instant, number = taken.instant[scan], number[scan, column]
    before = last_instant_before(object_of >= 0)[instant, number]
    own = object_of[np.where(before >= 0, before, instant), number]
    due = (own >= 0) & counted.due[instant, own]
    scan, column, own = scan[due], column[due], own[due]
    origin = taken.origin[scan, column]
    right = origin == own
    if taken.merged is not None:
        # A detection that two objects caused.
        right |= (origin >= 0) & (taken.merged[scan, column] == own)
    outcomes = {
        "association_right": right,
        "association_wrong_object": (origin >= 0) & ~right,
        "association_clutter": origin == FALSE_ALARM,
        "association_missed": (origin == NO_DETECTION) & taken.detected[scan, own],
    }
    counts = {name: float(outcome.sum()) for name, outcome in outcomes.items()}
    total = sum(counts.values())
    return {name: (count, total) for name, count in counts.items()}
