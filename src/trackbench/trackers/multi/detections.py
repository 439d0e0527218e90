"""The detections of all runs side by side."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices, Scan


class RunDetections(NamedTuple):
    """The N detections of a scan of many runs, those of a run together."""

    scan: Scan
    """``measurement`` ``(m, N)``, ``valid`` ``(N,)``, all True."""
    run: Indices
    """``(N,)``"""
    column: Indices
    """``(N,)`` where each stands in the scan of its run."""
    first: Indices
    """``(runs + 1,)`` the first detection of each run, and ``N``."""


def side_by_side(scan: Scan, as_listed: bool) -> RunDetections:
    """The detections of a scan ``(m, D, runs)`` without its padding.

    Within a run they stand as listed, or sorted by their values, so that the order of the list changes nothing.
    """
    most, runs = scan.valid.shape
    flat = scan.measurement.reshape(len(scan.measurement), -1)
    counts = scan.valid.sum(axis=0)
    run = np.repeat(np.arange(runs), counts)
    place = (np.flatnonzero(scan.valid.T) - run * most) * runs + run
    if not as_listed and len(run):
        place = place[_order(flat.take(place, axis=1), run)]
    alone = scan._replace(measurement=flat.take(place, axis=1), valid=np.ones(len(run), dtype=bool))
    return RunDetections(alone, run, place // runs, np.concatenate([[0], counts.cumsum()]))


def _order(measurement: Array, run: Indices) -> Indices:
    """How detections ``(m, N)`` stand that are sorted by their run, then by their values."""
    key = measurement[0]
    if run[-1]:
        # One number for both: the first component falls short of 1.
        lowest = key.min()
        spread = key.max() - lowest
        key = run + (key - lowest) / max(2.0 * spread, np.finfo(float).tiny)
    # In any order of those alike, which is the quickest; what is alike, or no number, is told apart by all components.
    order: Indices = key.argsort()
    ranked = key[order]
    return order if (ranked[1:] > ranked[:-1]).all() else np.lexsort((*measurement[::-1], run))
