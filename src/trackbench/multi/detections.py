"""The detections of all runs side by side."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.types import Indices, Scan


class RunDetections(NamedTuple):
    """The N detections of a scan of many runs, those of a run together."""

    scan: Scan
    """``measurement`` ``(m, N)``, ``valid`` ``(N,)``, all True."""
    run: Indices
    """``(N,)``"""
    column: Indices
    """``(N,)`` where each stands in the scan of its run."""
    first: Indices
    """``(runs,)`` the first detection of each run."""


def side_by_side(scan: Scan, as_listed: bool) -> RunDetections:
    """The detections of a scan ``(m, D, runs)`` without its padding.

    Within a run they stand as listed, or sorted by their values, so that the order of the list changes nothing.
    """
    most, runs = scan.valid.shape
    flat = scan.measurement.reshape(len(scan.measurement), -1)
    counts = scan.valid.sum(axis=0)
    run = np.repeat(np.arange(runs), counts)
    # Padding comes last, as NaN does when it is sorted.
    there = np.arange(most) < counts[:, None]
    if as_listed or most == 0:
        place = there.nonzero()[1] * runs + run
    else:
        place = np.argsort(scan.measurement[0].T, axis=1)[there] * runs + run
        first = flat[0].take(place)
        if (first[1:] == first[:-1]).any():
            place = np.lexsort(scan.measurement[::-1], axis=0).T[there] * runs + run
    alone = scan._replace(measurement=flat.take(place, axis=1), valid=np.ones(len(run), dtype=bool))
    return RunDetections(alone, run, place // runs, counts.cumsum() - counts)
