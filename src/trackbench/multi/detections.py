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
    rank: Indices
    """``(N,)`` the how-manieth of its run each is."""


def side_by_side(scan: Scan, as_listed: bool) -> RunDetections:
    """The detections of a scan ``(m, D, runs)`` without its padding.

    Within a run they stand as listed, or sorted by their values, so that the order of the list changes nothing.
    """
    measurement, valid = scan.measurement, scan.valid
    most, runs = valid.shape
    counts = np.count_nonzero(valid, axis=0)
    if as_listed or most == 0:
        order = np.broadcast_to(np.arange(most)[:, None], valid.shape)
    else:
        # Padding is NaN, which sorts last.
        order = np.lexsort(measurement[::-1], axis=0)
    column = order.T[np.arange(most) < counts[:, None]]
    run = np.repeat(np.arange(runs), counts)
    first = np.cumsum(counts) - counts
    flat = scan._replace(measurement=measurement[:, column, run], valid=np.ones(len(run), dtype=bool))
    return RunDetections(flat, run, column, first, np.arange(len(run)) - first[run])
