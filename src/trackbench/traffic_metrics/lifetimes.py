"""How soon, how long and how purely objects are tracked."""

from __future__ import annotations

import numpy as np

from trackbench.traffic_metrics.assignment import Counted
from trackbench.traffic_metrics.clear import NO_TRACK
from trackbench.types import Array, Indices, Mask


def durations(time: Array) -> Array:
    """``(T,)`` s from each instant to the next one; the last has the mean of the others, a single one none."""
    steps = np.diff(time)
    return np.append(steps, steps.mean() if len(steps) else 0.0)


def latencies(track_of: Indices, due: Mask, duration: Array) -> Array:
    """``(N,)`` s that each object was due before it was first tracked, NaN where it never was due.

    An object that is never tracked has the whole time that it was due: a lower bound.
    """
    waiting = due & ~np.logical_or.accumulate(track_of != NO_TRACK, axis=0)
    return np.where(due.any(axis=0), duration @ waiting, np.nan)


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
