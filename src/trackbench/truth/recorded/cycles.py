"""The cycles of a sensor, from the times of its rows, and the stretches of time into which scores are cut."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Indices, Truth
from trackbench.truth.base import Recorded

#: Of the intervals between two detections of one object this share is not longer than one period, even where
#: detections are few.
SHORT = 0.05
#: A sensor is regular if this share of its intervals are whole numbers of periods, within the tolerance.
REGULAR = 0.9
TOLERANCE = 0.25
#: Longer gaps, in periods, do not show whether a sensor is regular.
LONGEST = 5
#: Intervals without which no period is known.
FEWEST = 5
#: Cycles without a detection for each with one, at most; with more the sensor was rather off.
MOST_MISSED = 20


class Cycles(NamedTuple):
    """When a sensor looked."""

    instants: Array
    """``(instants,)`` the times of all rows, and of the cycles that left none; sorted."""
    cycle: Indices
    """``(instants,)`` the number of the cycle of each: a sensor may give its detections some ms apart."""
    period: float | None
    """s; None where the detections have no regular one."""


def cycles(time: Array, owner: Indices, scans: Array, most_missed: float = MOST_MISSED) -> Cycles:
    """The cycles between the first and the last row.

    Args:
        time: ``(rows,)`` s, of the detections, sorted.
        owner: ``(rows,)`` number of the object of each.
        scans: ``(scans,)`` s, all times at which the sensor is known to have looked; sorted.
        most_missed: cycles without a detection for each with one, at most.
    """
    instants = np.unique(np.concatenate([time, scans]))
    by_owner = np.argsort(owner, kind="stable")
    intervals = np.diff(time[by_owner])[np.diff(owner[by_owner]) == 0]
    if len(intervals) < FEWEST or len(instants) < 2:
        return Cycles(instants, np.arange(len(instants)), None)
    period = float(np.quantile(intervals, SHORT))
    if not period:
        return Cycles(instants, np.arange(len(instants)), None)
    number = _numbers(instants, period / 2)
    starts = instants[np.searchsorted(number, np.arange(number[-1] + 1))]
    steps = np.diff(starts)
    single = steps[steps < 1.5 * period]
    period = float(np.median(single)) if len(single) else period
    periods = steps / period
    near = np.abs(periods - np.round(periods))[periods < LONGEST + 0.5]
    missed = np.maximum(np.round(periods).astype(np.intp) - 1, 0)
    regular = len(near) >= FEWEST and (near < TOLERANCE).mean() >= REGULAR
    if not regular or missed.sum() > most_missed * len(starts):
        return Cycles(instants, number, None)
    added = [
        np.linspace(start, end, count + 2)[1:-1]
        for start, end, count in zip(starts[:-1], starts[1:], missed, strict=True)
        if count
    ]
    instants = np.unique(np.concatenate([instants, *added]))
    return Cycles(instants, _numbers(instants, period / 2), period)


def _numbers(instants: Array, apart: float) -> Indices:
    """Instants that are not more than ``apart`` after the first of a cycle belong to it."""
    number = np.empty(len(instants), dtype=np.intp)
    count, start = -1, -np.inf
    for i, instant in enumerate(instants.tolist()):
        if instant - start > apart:
            count, start = count + 1, instant
        number[i] = count
    return number


#: s.
SHORTEST = 4.0


def stretch_of(time: Array, count: int) -> Indices:
    """``(T,)`` number of the stretch of each instant, s: ``count`` of equal time between the first and the last."""
    length = float(np.ptp(time)) / count
    return np.asarray(np.minimum(((time - time.min()) / length).astype(np.intp), count - 1))


def require_long_enough(truth: Truth, recorded: Mapping[str, Recorded], count: int) -> None:
    """Refuse to cut a recording into so many stretches.

    Raises:
        InputError: they are too short, or one has no scan.
    """
    scans = truth.time[np.concatenate([own.steps for own in recorded.values()])] if recorded else truth.time
    length = float(np.ptp(scans)) / count
    if length < SHORTEST:
        message = f"{count} stretches of {length * count:.3g} s are shorter than {SHORTEST:g} s each"
        raise InputError(f"{message}; at most {int(length * count / SHORTEST)}", key="truth.stretches")
    if len(np.unique(stretch_of(scans, count))) < count:
        raise InputError(f"there is no scan in one of {count} stretches; take fewer", key="truth.stretches")
