"""A recorded drive, and the cycles of its sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices

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


def cycles(time: Array, owner: Indices, scans: Array) -> Cycles:
    """The cycles between the first and the last row.

    Args:
        time: ``(rows,)`` s, of the detections, sorted.
        owner: ``(rows,)`` number of the object of each.
        scans: ``(scans,)`` s, all times at which the sensor is known to have looked; sorted.
    """
    instants = np.unique(np.concatenate([time, scans]))
    period = _shortest(time, owner)
    if period is None or len(instants) < 2:
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
    if not regular or missed.sum() > MOST_MISSED * len(starts):
        return Cycles(instants, number, None)
    added = [
        np.linspace(start, end, count + 2)[1:-1]
        for start, end, count in zip(starts[:-1], starts[1:], missed, strict=True)
        if count
    ]
    instants = np.unique(np.concatenate([instants, *added]))
    return Cycles(instants, _numbers(instants, period / 2), period)


def _shortest(time: Array, owner: Indices) -> float | None:
    """The short intervals between two detections of one object, s."""
    intervals = np.concatenate([np.diff(time[owner == number]) for number in np.unique(owner)] or [np.empty(0)])
    return float(np.quantile(intervals, SHORT)) if len(intervals) >= FEWEST else None


def _numbers(instants: Array, apart: float) -> Indices:
    """Instants that are not more than ``apart`` after the first of a cycle belong to it."""
    number = np.empty(len(instants), dtype=np.intp)
    count, start = -1, -np.inf
    for i, instant in enumerate(instants.tolist()):
        if instant - start > apart:
            count, start = count + 1, instant
        number[i] = count
    return number


class Motion(NamedTuple):
    """The recorded motion of one body, each ``(rows,)``, at strictly increasing times."""

    time: Array
    """s from the truth's first instant."""
    px: Array
    py: Array
    vx: Array
    vy: Array
    heading: Array | None = None
    """rad; None: the course."""
    yaw_rate: Array | None = None
    """rad/s; None: from the heading."""


@dataclass(frozen=True)
class RowOrder:
    """The order in which rows stand in a file, before they are sorted."""

    rows: int
    backwards: int
    """Rows with an earlier time than one before them."""
    largest_step_back: float
    """s."""
    duplicates: int
    """Rows of the same object at the same time as a row before, which are left out."""


class Log(NamedTuple):
    """The recorded measurements of one sensor, one row a detection, sorted by time."""

    time: Array
    """``(rows,)`` s from the truth's first instant."""
    object: Indices
    """``(rows,)`` number of the object."""
    measurement: Array
    """``(m, rows)`` in SI units and radians; angles as they are written, not wrapped."""
    scans: Array
    """``(scans,)`` all times at which the file says that the sensor looked, those without a detection too; sorted."""
    order: RowOrder


@dataclass(frozen=True)
class Drive:
    """What the files of a recording say."""

    motions: dict[str, Motion]
    """By object."""
    order: RowOrder
    """Of the truth's rows."""
    observer: Motion | None
    """What carries the sensors; None: a fixed point."""
    logs: dict[str, Log]
    """By sensor."""
    source: dict[str, Any]
    """What the result says of the files."""

    def span(self, number: int) -> tuple[float, float]:
        """From when to when the truth of an object, and of the observer, is known, s."""
        known = [list(self.motions.values())[number], *([self.observer] if self.observer else [])]
        return max(float(m.time[0]) for m in known), min(float(m.time[-1]) for m in known)

    def inside(self, log: Log) -> Log:
        """The rows of a log within the span of their object's truth."""
        spans = np.array([self.span(number) for number in range(len(self.motions))])
        kept = (log.time >= spans[log.object, 0]) & (log.time <= spans[log.object, 1])
        first, last = spans[:, 0].min(), spans[:, 1].max()
        scans = log.scans[(log.scans >= first) & (log.scans <= last)]
        return log._replace(
            time=log.time[kept], object=log.object[kept], measurement=log.measurement[:, kept], scans=scans
        )

    def clipped(self) -> Drive:
        """The drive without measurements outside the span of the truth."""
        return replace(self, logs={name: self.inside(log) for name, log in self.logs.items()})


def row_order(time: Array, owner: Sequence[int] | Indices) -> tuple[Indices, RowOrder]:
    """The rows sorted by time and without duplicates, and what had to be done for that.

    Args:
        time: ``(rows,)``.
        owner: ``(rows,)`` number of the object of each.

    Returns:
        Numbers of the rows that are kept: of several of one object at one time, the first.
    """
    # Rows may stand object by object: only within those of one does time go on.
    each = [time[np.asarray(owner) == number] for number in np.unique(owner)]
    sorted_rows = np.argsort(time, kind="stable")
    pairs = np.stack([time[sorted_rows], np.asarray(owner, dtype=float)[sorted_rows]])
    kept = np.sort(np.unique(pairs, axis=1, return_index=True)[1])
    order = RowOrder(
        rows=len(time),
        backwards=sum(int((own < np.maximum.accumulate(own)).sum()) for own in each),
        largest_step_back=float(max([0.0, *(-np.diff(own).min(initial=0.0) for own in each)])),
        duplicates=len(time) - len(kept),
    )
    return sorted_rows[kept], order
