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

#: Rows of one file: each takes about 100 bytes of memory.
MOST_ROWS = 10_000_000
#: Longest and widest body that can be meant, m.
LARGEST_BODY_M = 100.0
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
    """Of its files, such as ``(".csv",)``; none where the recording comes with the package."""
    simultaneous: ClassVar[bool] = True
    """Whether the vehicles of a file drove at the same time."""
    from_sensor: ClassVar[bool] = False
    """Whether positions are relative to the sensor, so that the observer stands at the origin."""

    def __hash__(self) -> int:
        return hash((type(self), self.model_dump_json()))

    @abstractmethod
    def read(self, file: Path) -> Sequence[TrafficTrack]:
        """The tracks of a file.

        Raises:
            InputError: it cannot be read or is damaged; with its name, and the line where there are lines.
        """

    def rows(self, file: Path) -> TrackRows:
        """The rows of a file of tracks that a tracker gave; of formats that know no more, those of ``read``.

        Raises:
            InputError: as of ``read``.
        """
        return rows_of(self.read(file))


class RowsFormat(TrafficFormat):
    """A format whose files are rows of one time and one body each."""

    @abstractmethod
    def rows(self, file: Path) -> TrackRows: ...

    def read(self, file: Path) -> list[TrafficTrack]:
        rows = self.rows(file)
        if rows.dont_care is not None:
            rows = rows.rows(np.flatnonzero(~rows.dont_care))
        return tracks_of_rows(rows, file)


#: The formats of recorded traffic by the names that scenarios use.
TRAFFIC_FORMATS: Registry[type[TrafficFormat]] = Registry(
    "trackbench.traffic_formats", "format of recorded traffic", lacks_class(TrafficFormat)
)


def read_rows(form: TrafficFormat, file: Path) -> TrackRows:
    """All rows of a file, as they stand in it.

    Raises:
        InputError: it is damaged.
    """
    file = Path(os.path.normpath(file))
    version = file.stat()
    return _read_rows(form, file, (version.st_mtime_ns, version.st_size))


@lru_cache(maxsize=8)
def _read_rows(form: TrafficFormat, file: Path, _version: tuple[int, int]) -> TrackRows:
    return form.rows(file)


#: The quantity in each array of a track, a key of ``jumps.LARGEST``.
QUANTITIES = {"x": "length", "y": "length", "heading": "angle", **dict.fromkeys(("speed", "vx", "vy"), "speed")}


def tracks_of_rows(rows: TrackRows, file: Path) -> list[TrafficTrack]:
    """The tracks of rows in any order, each with the size and class of its first row; a size of 0 is not known.

    Raises:
        InputError: there is no row, or a body has two rows of one time.
    """
    if not len(rows):
        raise InputError("there is no vehicle in this file", file=file)
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
        heading, speeds, *velocity = (
            None if column is None else column[own] for column in (rows.heading, speed, *rows.velocity)
        )
        length, width = (
            None if column is None or column[row] == 0 or np.isnan(column[row]) else float(column[row])
            for column in (rows.length, rows.width)
        )
        kind = "" if rows.kind is None else rows.kind[row]
        place = name, time[own], rows.px[own], rows.py[own]
        tracks.append(TrafficTrack(*place, heading, speeds, length, width, kind, *velocity))
    return tracks


def rows_of(tracks: Sequence[TrafficTrack]) -> TrackRows:
    """The rows of tracks; a column that some lack is NaN there."""

    def column(name: str) -> Array | None:
        values = [(getattr(track, name), len(track.time)) for track in tracks]
        if all(value is None for value, _ in values):
            return None
        parts = [np.broadcast_to(np.nan if value is None else value, rows) for value, rows in values]
        return np.concatenate(parts)

    def names(name: str) -> list[str]:
        return [getattr(track, name) for track in tracks for _ in range(len(track.time))]

    time, px, py = (np.concatenate([getattr(track, name) for track in tracks]) for name in ("time", "x", "y"))
    more: dict[str, Any] = {name: column(name) for name in ("heading", "speed", "length", "width")}
    return TrackRows(names("id"), time, px, py, **more, kind=names("kind"))


def start_of(tracks: Sequence[TrafficTrack]) -> float:
    """The time of the first row of tracks of two rows or more, s."""
    return min(float(track.time[0]) for track in tracks if len(track.time) > 1)


def moving_tracks(tracks: Sequence[TrafficTrack], file: Path) -> list[TrafficTrack]:
    """The tracks with at least two rows, from the time of the first row on.

    Raises:
        InputError: as of ``require_possible_tracks``, or no track has two rows.
    """
    require_possible_tracks(tracks, file)
    kept = [track for track in tracks if len(track.time) > 1]
    if not kept:
        raise InputError("no vehicle has two rows; there is no motion in this file", file=file)
    start = start_of(kept)
    return [track._replace(time=track.time - start) for track in kept]


def require_possible_tracks(tracks: Sequence[TrafficTrack], file: Path) -> None:
    """Make sure that what a file says can be meant.

    Raises:
        InputError: a name, a size, a number or a time cannot be, or there are too many rows.
    """
    if sum(len(track.time) for track in tracks) > MOST_ROWS:
        raise InputError(f"more than {MOST_ROWS} rows; cut the recording", file=file)
    seen: set[str] = set()
    for track in tracks:
        problem = _problem(track)
        if problem is None and track.id in seen:
            problem = "there is more than one vehicle of this name"
        if problem is not None:
            raise InputError(f"vehicle {track.id[:20]!r}: {problem}", file=file)
        seen.add(track.id)
    ends = np.array([track.time[[0, -1]] for track in tracks if len(track.time)])
    if ends.size and np.ptp(ends) > jumps.LONGEST:
        raise InputError(f"its last row is {jumps.why_too_long(float(np.ptp(ends)))}", file=file)


def _problem(track: TrafficTrack) -> str | None:
    """What is wrong with a track; None if nothing is."""
    name = jumps.why_no_name(track.id)
    if name is not None or not track.id:
        return name or "its name is empty"
    if not np.isfinite(track.time).all() or np.abs(track.time).max(initial=0.0) > 1e15:
        return "a time is not a finite number, or too large to be meant"
    if (np.diff(track.time) <= 0).any():
        return "its times do not increase"
    for size in ("length", "width"):
        value = getattr(track, size)
        if value is not None and not 0 < value <= LARGEST_BODY_M:
            return f"its {size} is {value:g} m; above 0 and at most {LARGEST_BODY_M:g} m is possible"
    for key, quantity in QUANTITIES.items():
        values = getattr(track, key)
        if values is None:
            continue
        if len(values) != len(track.time):
            return f"{key} has {len(values)} rows, and the time {len(track.time)}"
        row = int(np.argmax(~(np.abs(values) <= jumps.LARGEST[quantity])))
        if not np.isfinite(values[row]):
            return f"{key} is not a finite number at {track.time[row]:g} s"
        too_large = jumps.why_too_large(float(values[row]), quantity)
        if too_large is not None:
            return f"{key} at {track.time[row]:g} s: {too_large}"
    return None
