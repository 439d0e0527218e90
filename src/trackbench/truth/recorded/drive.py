"""A recorded drive as its files say it, before truth and measurements are put on one grid of times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from trackbench.base.types import Array, Indices


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
