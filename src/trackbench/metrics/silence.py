"""What a tracker is charged with where it gave no estimate that was due: no more than anyone could have said.

That is the latest measured position and no velocity. A tracker that gave an estimate before could have left that
standing; it is charged with the worse of the two, so that leaving out a bad estimate never pays.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import numpy as np

from trackbench.base.types import SAME_TIME, Array, Mask


class MeasuredScan(NamedTuple):
    """What a scan states of the positions of known objects."""

    sensor: str
    time: float
    """s"""
    arrival_time: float
    """s"""
    valid: Mask
    """``(batch,)``"""
    position: Callable[[], Array]
    """Gives ``(2, batch)`` m in the fixed frame."""


def measured_positions(scans: Sequence[MeasuredScan], sensors: Collection[str] | None, time: Array) -> Array:
    """``(2, instants, batch)`` m, the position that the latest measurement of each object states, held until the next
    one arrives: of the sensors that a tracker reads, before their first measurement of it that of any sensor.

    NaN before that. Of measurements at one instant the later in the order of scans counts.

    Args:
        scans: in the order in which they were taken.
        sensors: names of those that the tracker reads; None: all.
        time: ``(instants,)`` s.
    """
    every = _held(scans, time)
    if sensors is None:
        return every
    read = _held([scan for scan in scans if scan.sensor in sensors], time)
    return np.where(np.isnan(read), every, read) if read.size else every


def _held(scans: Sequence[MeasuredScan], time: Array) -> Array:
    by_arrival = sorted(scans, key=lambda scan: (scan.arrival_time, scan.time))
    batch = by_arrival[0].valid.size if by_arrival else 0
    latest, taken = np.full((2, batch), np.nan), np.full(batch, -np.inf)
    positions, first = np.full((2, len(time), batch), np.nan), 0
    for scan in by_arrival:
        arrived = int(np.searchsorted(time, scan.arrival_time - SAME_TIME))
        positions[:, first:arrived], first = latest[:, None], max(first, arrived)
        newer = scan.valid & (scan.time >= taken)
        latest = np.where(newer, scan.position(), latest)
        taken = np.where(newer, scan.time, taken)
    positions[:, first:] = latest[:, None]
    return positions


def own_estimates(latest: Array, mean: Array, given: Mask, expected: Mask) -> Array:
    """``(4, instants, batch)`` the latest estimate that was given of each object, held; NaN before the first.

    Args:
        latest: ``(4, batch)`` before the first of these instants.
        mean: ``(4, instants, batch)``.
        given: ``(instants, batch)``.
        expected: ``(instants, batch)`` where the object is in view; one that comes back later counts as a new one.
    """
    every = np.concatenate([latest[:, None], np.where(expected, mean, np.nan)], axis=1)
    number = np.where(given | ~expected, np.arange(1, len(given) + 1)[:, None], 0)
    return np.take_along_axis(every, np.maximum.accumulate(number)[None], axis=1)


def charged_states(truth: Array, measured: Array, own: Array) -> Array:
    """``(4, n)`` the state that stands for an estimate that is missing: of position and of velocity each the worse.

    Args:
        truth: ``(4, n)``.
        measured: ``(2, n)`` the latest measured position, m.
        own: ``(4, n)`` the tracker's latest own estimate; NaN where it gave none before.
    """
    anyone = np.concatenate([measured, np.zeros_like(measured)])
    own_error, error = ((state - truth) ** 2 for state in (own, anyone))
    # Not true of NaN.
    worse = [own_error[row] + own_error[row + 1] > error[row] + error[row + 1] for row in (0, 2)]
    return np.where(np.repeat(worse, 2, axis=0), own, anyone)
