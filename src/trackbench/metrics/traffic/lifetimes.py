"""How soon, how long and how purely objects are tracked."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Indices, Mask
from trackbench.metrics.traffic.assignment import Counted
from trackbench.metrics.traffic.clear import NO_TRACK


def durations(time: Array) -> Array:
    """``(T,)`` s from each instant to the next one; the last has the mean of the others, a single one none."""
    steps = np.diff(time)
    return np.append(steps, steps.mean() if len(steps) else 0.0)


def latencies(track_of: Indices, due: Mask, duration: Array) -> Array:
    """``(N,)`` s that each object was due before it was first tracked; infinite where it never was tracked, NaN
    where it never was due.
    """
    ever = (track_of != NO_TRACK).any(axis=0)
    return np.where(due.any(axis=0), np.where(ever, _waiting(track_of, due, duration), np.inf), np.nan)


def confirmation(track_of: Indices, due: Mask, duration: Array) -> tuple[float, float]:
    """Seconds that objects were due before their first track, or all the time without one; objects that got one.

    The ratio is the mean time to an event where it is not always waited for, and the maximum-likelihood estimate for a
    constant rate. Source: Lawless (2003), "Statistical Models and Methods for Lifetime Data", section 4.1 (total time
    on test over number of failures).
    """
    tracked = due.any(axis=0) & (track_of != NO_TRACK).any(axis=0)
    return float(_waiting(track_of, due, duration).sum()), float(tracked.sum())


def _waiting(track_of: Indices, due: Mask, duration: Array) -> Array:
    return np.asarray(duration @ (due & ~np.logical_or.accumulate(track_of != NO_TRACK, axis=0)))


def lost(track_of: Indices, due: Mask) -> tuple[float, float]:
    """Due instants without a track after the object's first one, of all due instants from then on."""
    tracked = track_of != NO_TRACK
    since = due & np.logical_or.accumulate(tracked, axis=0)
    return float((since & ~tracked).sum()), float(since.sum())


def purity(counted: Counted) -> tuple[float, float]:
    """Instants that each track spends on the object it is on most, of all that it spends on any."""
    matched, objects, tracks = counted.matched, counted.due.shape[1], len(counted.ids)
    together = np.bincount(matched.object * tracks + matched.track, minlength=objects * tracks)
    most = together.reshape(objects, tracks).max(axis=0, initial=0)
    return float(most.sum()), float(together.sum())


def false_tracks(counted: Counted) -> Indices:
    """Numbers of the tracks that never are on any object, due or optional."""
    real = np.zeros(len(counted.ids), dtype=bool)
    real[counted.matched.track] = True
    real[counted.excused.track] = True
    return np.flatnonzero(~real)
