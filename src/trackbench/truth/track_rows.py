"""The table of tracks: rows of boxes that are true, or that a tracker says are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from decimal import Decimal
from pathlib import Path
from typing import Any, Self

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.types import Array, Indices, Mask

#: Time stamps this near to each other, s, are the same: files are written with microseconds.
SAME_STAMP_S = 1e-6
#: A longer time between two rows, s and usual times between them, is a gap.
LONGEST_GAP_S, LONGEST_GAP_ROWS = 0.5, 3
#: Upper triangle of a covariance of px, py, vx, vy, by the names of its columns.
COVARIANCE = {f"p_{a}{b}": (a, b) for a in range(4) for b in range(a, 4)}


def longest_gap(usual: float) -> float:
    """The longest time between two rows that is none, s, where they usually are ``usual`` s apart."""
    return max(LONGEST_GAP_S, LONGEST_GAP_ROWS * usual)


@dataclass(frozen=True)
class TrackRows:
    """Rows of one time and one id each, in any order, in SI units and radians.

    Optional columns are None where the file has none; single rows without a value have NaN, or an empty text.
    """

    id: Sequence[str]
    """``(rows,)``."""
    time: Array
    """``(rows,)`` s after ``start``."""
    px: Array
    """``(rows,)`` m, of the body's centre in the fixed frame."""
    py: Array
    """``(rows,)`` m; counter-clockwise angles are positive."""
    vx: Array | None = None
    """``(rows,)`` m/s."""
    vy: Array | None = None
    heading: Array | None = None
    """``(rows,)`` rad."""
    speed: Array | None = None
    """``(rows,)`` m/s, where the file has it in place of vx and vy."""
    covariance: Array | None = None
    """``(4, 4, rows)`` of px, py, vx, vy; NaN where the file does not state an entry."""
    existence: Array | None = None
    """``(rows,)`` probability that the object exists."""
    length: Array | None = None
    """``(rows,)`` m."""
    width: Array | None = None
    """``(rows,)`` m."""
    kind: Sequence[str] | None = None
    """``(rows,)`` class, such as car, in the file's own words."""
    dont_care: Mask | None = None
    """``(rows,)`` where the file says that a row is of no object, and a track there neither right nor false."""
    scene: Sequence[str] | None = None
    """``(rows,)`` name of the bench's scene, as the next two where tracks were made from exported scans."""
    run: Sequence[str] | None = None
    """``(rows,)`` number of the run within its scene."""
    fingerprint: Sequence[str] | None = None
    """``(rows,)`` of the run's measurements."""
    start: Decimal = Decimal(0)
    """s of the file's clock from which ``time`` counts: nanoseconds since 1970 keep their differences."""
    notes: tuple[str, ...] = ()
    """What was read from where, a line each: ``time <- timestamp_ns (ns)``."""

    def __len__(self) -> int:
        return len(self.time)

    @property
    def velocity(self) -> tuple[Array | None, Array | None]:
        """vx and vy as stated, or by speed and heading; None where the file states neither."""
        if self.vx is None and self.speed is not None and self.heading is not None:
            return self.speed * np.cos(self.heading), self.speed * np.sin(self.heading)
        return self.vx, self.vy

    def rows(self, chosen: Indices) -> Self:
        """Some of the rows, by their numbers."""
        columns: dict[str, Any] = {}
        for name in (item.name for item in fields(self)):
            value = getattr(self, name)
            if isinstance(value, np.ndarray):
                columns[name] = value[..., chosen]
            elif isinstance(value, Sequence) and name != "notes":
                columns[name] = [value[row] for row in chosen.tolist()]
        return replace(self, **columns)

    def ordered(self, file: Path) -> Self:
        """The rows in the order of time.

        Raises:
            InputError: an id has two rows at one time, in one run.
        """
        keys = [self.id, *(column for column in (self.scene, self.run) if column is not None)]
        owner = np.unique([np.unique(key, return_inverse=True)[1] for key in keys], axis=1, return_inverse=True)[1]
        by_owner = np.lexsort((self.time, owner))
        again = (np.diff(owner[by_owner]) == 0) & (np.diff(self.time[by_owner]) == 0)
        if again.any():
            row = int(by_owner[int(np.argmax(again))])
            raise InputError(f"{self.id[row]} has two rows at {self.time[row]:.9g} s", file=file)
        return self.rows(np.argsort(self.time, kind="stable"))
