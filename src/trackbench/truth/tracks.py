"""Recorded traffic: the rows and the tracks of a file, and the formats that read them."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from decimal import Decimal
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from trackbench.base.config import Config
from trackbench.base.errors import InputError
from trackbench.base.plugins import Registry, lacks_class
from trackbench.base.types import Array, Indices, Mask
from trackbench.truth import jumps

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

    def __len__(self) -> int:
        return len(self.time)

    @property
    def velocity(self) -> tuple[Array | None, Array | None]:
        """vx and vy as stated, or by speed and heading; None where the file states neither."""
        if self.vx is None and self.speed is not None and self.heading is not None:
            return self.speed * np.cos(self.heading), self.speed * np.sin(self.heading)
        return self.vx, self.vy

    def require_possible(self, file: Path) -> None:
        """Make sure that what a file says can be meant.

        Raises:
            InputError: there is no row; a name, a number or the length of time cannot be.
        """
        if not len(self):
            raise InputError("there is no vehicle in this file", file=file)
        for key, quantity in QUANTITIES.items():
            values = getattr(self, key)
            if values is None:
                continue
            is_wrong = np.abs(values) > jumps.LARGEST[quantity]
            is_wrong |= np.isnan(values) & (key in ("time", "px", "py"))
            if is_wrong.any():
                row = int(np.argmax(is_wrong))
                what = f"vehicle {self.id[row][:20]!r}: {key} at {self.time[row]:g} s is {values[row]:.3g}"
                raise InputError(f"{what}, which cannot be meant: check its unit", file=file)
        for name in {*self.id}:
            if not name or not name.isprintable():
                raise InputError(f"{name[:20]!r} is no name of a vehicle", file=file)
        if (length_s := float(np.ptp(self.time))) > jumps.LONGEST:
            raise InputError(f"its last row is {jumps.why_too_long(length_s)}", file=file)

    def rows(self, chosen: Indices) -> Self:
        """Some of the rows, by their numbers."""
        columns: dict[str, Any] = {}
        for name in (item.name for item in fields(self)):
            value = getattr(self, name)
            if isinstance(value, np.ndarray):
                columns[name] = value[..., chosen]
            elif isinstance(value, Sequence):
                columns[name] = [value[row] for row in chosen.tolist()]
        return replace(self, **columns)

    def ordered(self, file: Path) -> Self:
        """Return the rows in the order of time.

        Raises:
            InputError: as of :meth:`require_possible`, or an id has two rows at one time, in one run.
        """
        self.require_possible(file)
        keys = [self.id, *(column for column in (self.scene, self.run) if column is not None)]
        owner = np.unique([np.unique(key, return_inverse=True)[1] for key in keys], axis=1, return_inverse=True)[1]
        by_owner = np.lexsort((self.time, owner))
        again = (np.diff(owner[by_owner]) == 0) & (np.diff(self.time[by_owner]) == 0)
        if again.any():
            row = int(by_owner[int(np.argmax(again))])
            raise InputError(f"{self.id[row]} has two rows at {self.time[row]:.9g} s", file=file)
        return self.rows(np.argsort(self.time, kind="stable"))


class TrafficTrack(NamedTuple):
    """One body of recorded traffic: what a file states of it, in SI units and radians."""

    id: str
    time: Array
    """``(rows,)`` s, strictly increasing."""
    x: Array
    """``(rows,)`` m, of the body's centre."""
    y: Array
    """``(rows,)`` m; counter-clockwise angles are positive."""
    heading: Array | None = None
    """``(rows,)`` rad; None where the file has none: the course."""
    speed: Array | None = None
    """``(rows,)`` m/s; None where the file has none: from the displacement."""
    length: float | None = None
    """m; None where the file has none."""
    width: float | None = None
    """m; None where the file has none."""
    kind: str = ""
    """Its class, such as car, in the file's own words."""
    vx: Array | None = None
    """``(rows,)`` m/s; None where the file has neither it nor speed and heading."""
    vy: Array | None = None
    """``(rows,)`` m/s."""


class TrafficFormat(Config, ABC):
    """A file format of recorded traffic. The fields of a subclass are its options in a scenario."""

    endings: ClassVar[tuple[str, ...]]
    """Endings of its files, such as ``(".csv",)``; none where the recording comes with the package."""
    simultaneous: ClassVar[bool] = True
    """Whether the vehicles of a file drove at the same time."""
    from_sensor: ClassVar[bool] = False
    """Whether positions are relative to the sensor, so that the observer stands at the origin."""

    def __hash__(self) -> int:
        return hash((type(self), self.model_dump_json()))

    @abstractmethod
    def rows(self, file: Path) -> TrackRows:
        """Return the rows of a file, as they stand in it.

        Raises:
            InputError: it cannot be read or is damaged; with its name, and the line where there are lines.
        """

    def read(self, file: Path) -> list[TrafficTrack]:
        """Return the tracks of a file, without don't-care boxes.

        Raises:
            InputError: as of :meth:`rows` and :func:`tracks_of_rows`.
        """
        rows = self.rows(file)
        return tracks_of_rows(rows if rows.dont_care is None else rows.rows(np.flatnonzero(~rows.dont_care)), file)


#: The formats of recorded traffic by the names that scenarios use.
TRAFFIC_FORMATS: Registry[type[TrafficFormat]] = Registry(
    "trackbench.traffic_formats", "format of recorded traffic", lacks_class(TrafficFormat)
)


def read_rows(form: TrafficFormat, file: Path) -> TrackRows:
    """Return all rows of a file, as they stand in it.

    Raises:
        InputError: it is damaged.
    """
    file = Path(os.path.normpath(file))
    version = file.stat()
    return _read_rows(form, file, (version.st_mtime_ns, version.st_size))


@lru_cache(maxsize=8)
def _read_rows(form: TrafficFormat, file: Path, _version: tuple[int, int]) -> TrackRows:
    rows = form.rows(file)
    rows.require_possible(file)
    return rows


#: The quantity in each array of rows.
QUANTITIES = {
    "time": "time",
    **dict.fromkeys(("px", "py"), "length"),
    "heading": "angle",
    **dict.fromkeys(("speed", "vx", "vy"), "speed"),
}


def tracks_of_rows(rows: TrackRows, file: Path) -> list[TrafficTrack]:
    """Return the tracks of rows in any order, each with the size and class of its first row.

    A size of 0 is not known, and a column without a value in any row of a track is none.

    Raises:
        InputError: as of :meth:`TrackRows.require_possible`; a body has two rows of one time, or a size that none has.
    """
    rows.require_possible(file)
    time = rows.time + float(rows.start)
    speed = rows.speed if rows.vx is None or rows.vy is None else np.hypot(rows.vx, rows.vy)
    names, first, owner = np.unique(np.asarray(rows.id), return_index=True, return_inverse=True)
    order = np.lexsort((time, owner))
    members = np.split(order, np.searchsorted(owner[order], np.arange(1, len(names))))
    tracks = []
    for number in np.argsort(first).tolist():
        own, row, name = members[number], int(first[number]), str(names[number])
        again = np.flatnonzero(np.diff(time[own]) <= 0)
        if len(again):
            raise InputError(f"{name} has two rows at {time[own][again[0]]:g} s", file=file)
        stated = (
            None if column is None or np.isnan(column[own]).all() else column[own]
            for column in (rows.heading, speed, *rows.velocity)
        )
        heading, speeds, *velocity = stated
        for what, values in (("heading", heading), ("speed", speeds)):
            if values is not None and np.isnan(values).any():
                at = time[own][np.isnan(values)][0]
                raise InputError(f"vehicle {name[:20]!r}: {what} is not a finite number at {at:g} s", file=file)
        length, width = (_size(name, key, getattr(rows, key), row, file) for key in ("length", "width"))
        kind = "" if rows.kind is None else rows.kind[row]
        place = name, time[own], rows.px[own], rows.py[own]
        tracks.append(TrafficTrack(*place, heading, speeds, length, width, kind, *velocity))
    return tracks


def _size(name: str, key: str, sizes: Array | None, row: int, file: Path) -> float | None:
    if sizes is None or sizes[row] == 0 or np.isnan(sizes[row]):
        return None
    least, most, _ = jumps.POSSIBLE["size"]
    if not least <= sizes[row] <= most:
        problem = f"its {key} is {sizes[row]:g} m; {least:g} to {most:g} m is possible"
        raise InputError(f"vehicle {name[:20]!r}: {problem}", file=file)
    return float(sizes[row])


def moving_tracks(tracks: Sequence[TrafficTrack], file: Path) -> tuple[list[TrafficTrack], float]:
    """Return the tracks with at least two rows, from the time of the first row on, and that time, s.

    Raises:
        InputError: no track has two rows.
    """
    kept = [track for track in tracks if len(track.time) > 1]
    if not kept:
        raise InputError("no vehicle has two rows; there is no motion in this file", file=file)
    start = min(float(track.time[0]) for track in kept)
    return [track._replace(time=track.time - start) for track in kept], start
