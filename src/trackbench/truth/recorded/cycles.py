"""Cycles of a sensor from the times of its rows, and stretches of time for which scores are cut."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Indices, Truth
from trackbench.truth.base import Recorded

#: Share of the intervals between two detections of one object that is at most one period long, even if detections
#: are rare.
SHORT = 0.05
#: Least share of intervals that are whole numbers of periods, within the tolerance, for a regular sensor.
REGULAR = 0.9
TOLERANCE = 0.25
#: Longest gap, in periods, that shows whether a sensor is regular.
LONGEST = 5
#: Least number of intervals for which a period is estimated.
FEWEST = 5
#: Largest ratio of cycles without and with a detection; with more the sensor was probably off.
MOST_MISSED = 20


class Cycles(NamedTuple):
    """Times of a sensor's rows, and the measurement cycle that each belongs to."""

    instants: Array
    """``(instants,)`` distinct times of all rows, and estimated times of cycles without rows, s; sorted."""
    cycle: Indices
    """``(instants,)`` index of each instant's cycle, since the detections of a cycle may be some ms apart."""
    period: float | None
    """Time between cycles, s; None if detections are irregular."""


def cycles(time: Array, owner: Indices, scans: Array, most_missed: float = MOST_MISSED) -> Cycles:
    """Find the measurement cycles of a sensor from the times of its detections.

    Args:
        time: ``(rows,)`` times of the detections, s, sorted.
        owner: ``(rows,)`` index of each row's object.
        scans: ``(scans,)`` all known times of scans, s, sorted.
        most_missed: largest number of cycles without a detection for each cycle with one; beyond, no period is found.
    """
    instants = np.unique(np.concatenate([time, scans]))
    by_owner = np.argsort(owner, kind="stable")
    intervals = np.diff(time[by_owner])[np.diff(owner[by_owner]) == 0]
    if len(intervals) < FEWEST or len(instants) < 2:
        return Cycles(instants, np.arange(len(instants)), None)
    period = float(np.quantile(intervals, SHORT))
    if not period:
        return Cycles(instants, np.arange(len(instants)), None)
    number = _cycle_numbers(instants, period / 2)
    starts = instants[np.searchsorted(number, np.arange(number[-1] + 1))]
    steps = np.diff(starts)
    single = steps[steps < 1.5 * period]
    period = float(np.median(single)) if len(single) else period
    periods = steps / period
    deviation = np.abs(periods - np.round(periods))[periods < LONGEST + 0.5]
    missed = np.maximum(np.round(periods).astype(np.intp) - 1, 0)
    is_regular = len(deviation) >= FEWEST and (deviation < TOLERANCE).mean() >= REGULAR
    if not is_regular or missed.sum() > most_missed * len(starts):
        return Cycles(instants, number, None)
    added = [
        np.linspace(start, end, count + 2)[1:-1]
        for start, end, count in zip(starts[:-1], starts[1:], missed, strict=True)
        if count
    ]
    instants = np.unique(np.concatenate([instants, *added]))
    return Cycles(instants, _cycle_numbers(instants, period / 2), period)


def _cycle_numbers(instants: Array, length: float) -> Indices:
    """Return the cycle index of each instant; a cycle ends ``length`` s after its first instant."""
    number = np.empty(len(instants), dtype=np.intp)
    count, start = -1, -np.inf
    for i, instant in enumerate(instants.tolist()):
        if instant - start > length:
            count, start = count + 1, instant
        number[i] = count
    return number


#: Shortest stretch, s.
SHORTEST = 4.0


def stretch_of(time: Array, count: int) -> Indices:
    """Return the stretch index of each time, ``(T,)``, when the time is cut into ``count`` equal stretches."""
    length = float(np.ptp(time)) / count
    return np.asarray(np.minimum(((time - time.min()) / length).astype(np.intp), count - 1))


def require_long_enough(truth: Truth, recorded: Mapping[str, Recorded], count: int) -> None:
    """Raise an error if a recording is too short to be cut into ``count`` stretches of time.

    Raises:
        InputError: the stretches are too short, or one has no scan.
    """
    scans = truth.time[np.concatenate([own.steps for own in recorded.values()])] if recorded else truth.time
    length = float(np.ptp(scans)) / count
    if length < SHORTEST or len(np.unique(stretch_of(scans, count))) < count:
        message = f"one of {count} stretches is shorter than {SHORTEST:g} s, or has no scan"
        raise InputError(f"{message}: take at most {int(length * count / SHORTEST)}", key="truth.stretches")
