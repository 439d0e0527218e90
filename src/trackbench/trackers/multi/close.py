"""Pairs of a track and a detection that are close in one component."""

from __future__ import annotations

import numpy as np

from trackbench.base.types import Array, Indices
from trackbench.base.units import wrap_angle
from trackbench.trackers.multi.detections import RunDetections

#: From so many pairs on, only those in the same cells are compared.
MANY = 20_000
#: Over how many cells the detections of a run are spread.
CELLS = 128
#: By how much a reach is extended when its cells are looked up, in cells.
MARGIN = 1e-6


def close_pairs(
    mean: Array, reach: Array, run: Indices, value: Array, detections: RunDetections, angular: bool
) -> tuple[Indices, Indices]:
    """Tracks and detections of the same run, sorted by both, that are not farther apart than the track's reach.

    Args:
        mean, reach: ``(L,)`` of the component, for each track.
        run: ``(L,)`` of each track.
        value: ``(N,)`` of the component, for each detection.
        detections: of all runs.
        angular: whether the component is an angle.
    """
    first = detections.first
    rank = np.arange(len(value)) - first[detections.run]
    most = int(rank.max(initial=-1)) + 1
    if len(run) * most > MANY and not angular:
        found = _by_cells(mean, reach, run, value, detections)
        if found is not None:
            return found
    listed = np.full((len(first) - 1, most), np.nan)
    listed[detections.run, rank] = value
    away = listed.take(run, axis=0)
    away -= mean[:, None]
    if angular:
        away = wrap_angle(away)
    # Nonzero entries of one axis are found several times faster than those of two.
    pair = np.flatnonzero(np.abs(away, out=away) <= reach[:, None])
    track = pair // max(most, 1)
    return track, first[run[track]] + pair - track * most


def _by_cells(
    mean: Array, reach: Array, run: Indices, value: Array, detections: RunDetections
) -> tuple[Indices, Indices] | None:
    """The same, comparing only what lies in the same cells; None where the detections do not stand in their order."""
    lowest = value.min()
    spread = value.max() - lowest
    if not 0.0 < spread < np.inf:
        return None
    per_unit = (CELLS - 0.5) / spread
    cell = ((value - lowest) * per_unit).astype(np.intp) + detections.run * CELLS
    if (cell[1:] < cell[:-1]).any():
        return None
    cells = (len(detections.first) - 1) * CELLS
    begins = np.zeros(cells + 1, dtype=np.intp)
    np.cumsum(np.bincount(cell, minlength=cells), out=begins[1:])
    at, around, own = (mean - lowest) * per_unit, reach * per_unit + MARGIN, run * CELLS
    # What is not a number is close to nothing; it is looked up in the first cell.
    low, high = (np.fmin(np.fmax(edge, 0.0), CELLS - 1).astype(np.intp) + own for edge in (at - around, at + around))
    begin = begins[low]
    count = begins[high + 1] - begin
    track = np.arange(len(run)).repeat(count)
    detection = np.arange(len(track)) + (begin - np.cumsum(count) + count)[track]
    close = np.flatnonzero(np.abs(value[detection] - mean[track]) <= reach[track])
    return track[close], detection[close]
