"""SIAP: how complete and how clear the picture is, where several tracks may stand for one object."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.metrics.traffic.assignment import Counted
from trackbench.metrics.traffic.histories import TrackHistory, TruthHistory


class Siap(NamedTuple):
    """Attributes of the single integrated air picture, as sums and the numbers of their terms."""

    completeness: tuple[float, float]
    """Objects with a track, of all objects."""
    ambiguity: tuple[float, float]
    """Tracks on an object, of objects with a track."""
    spuriousness: tuple[float, float]
    """Tracks on no object, of all tracks."""
    position: tuple[float, float]
    """Distances of tracks on objects, m."""
    velocity: tuple[float, float]
    """The same of velocities, m/s; tracks without a velocity do not count."""


def siap(truth: TruthHistory, tracks: TrackHistory, counted: Counted) -> Siap:
    """Each track stands at each instant for the nearest due object within the cutoff.

    Source: Votruba et al. (2001), "Single Integrated Air Picture (SIAP) metrics implementation".
    """
    pairs = counted.pairs
    track = pairs.instant * counted.present.shape[1] + pairs.column
    nearest = np.lexsort((pairs.distance, track))
    own = nearest[np.diff(track[nearest], prepend=-1) != 0]
    instant, item, column = pairs.instant[own], pairs.object[own], pairs.column[own]
    tracked = np.zeros_like(counted.due)
    tracked[instant, item] = True
    objects, present, on = float(counted.due.sum()), float(counted.present.sum()), float(len(own))
    velocity = np.hypot(*(tracks.mean[2:, instant, column] - truth.state[2:, instant, item]))
    known = velocity[np.isfinite(velocity)]
    return Siap(
        completeness=(float(tracked.sum()), objects),
        ambiguity=(on, float(tracked.sum())),
        spuriousness=(present - on, present),
        position=(float(pairs.distance[own].sum()), on),
        velocity=(float(known.sum()), float(len(known))),
    )
