"""IDF1: how much of the objects' time one track each covers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.scipy_functions import largest_assignment
from trackbench.base.types import Indices
from trackbench.metrics.traffic.assignment import NearPairs


class IdentityCounts(NamedTuple):
    """Instants of objects and tracks."""

    true: int
    """IDTP: an object and the track that stands for it over the run are together."""
    missed: int
    """IDFN."""
    false: int
    """IDFP."""


def identity(pairs: NearPairs, object_counts: Indices, track_counts: Indices) -> IdentityCounts:
    """Counts of the one-to-one matching of objects and tracks, for the whole run, with most instants together.

    Source: Ristani et al. (2016), "Performance measures and a data set for multi-target, multi-camera tracking".

    Args:
        pairs: all that are near enough to be the same.
        object_counts: ``(N,)`` instants at which each object is there.
        track_counts: ``(tracks,)`` the same of the tracks.
    """
    objects, tracks = len(object_counts), len(track_counts)
    together = np.bincount(pairs.object * tracks + pairs.track, minlength=objects * tracks)
    table = together.reshape(objects, tracks).astype(float)
    true = int(table[largest_assignment(table)].sum())
    return IdentityCounts(true, int(object_counts.sum()) - true, int(track_counts.sum()) - true)
