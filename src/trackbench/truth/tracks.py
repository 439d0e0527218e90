"""Rows and tracks of recorded traffic, and the interface of the file formats."""

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

#: Largest difference of equal time stamps, s: files are written with microseconds.
SAME_STAMP_S = 1e-6
#: Longest time between two rows that is no gap, in s and in usual times between rows; the larger counts.
LONGEST_GAP_S, LONGEST_GAP_ROWS = 0.5, 3
#: Upper triangle of a covariance of px, py, vx, vy, by the names of its columns.
COVARIANCE = {f"p_{a}{b}": (a, b) for a in range(4) for b in range(a, 4)}


def longest_gap(usual: float) -> float:
    """Return the longest time between two rows that is not a gap, s, where rows are usually ``usual`` s apart."""
    return max(LONGEST_GAP_S, LONGEST_GAP_ROWS * usual)


@dataclass(frozen=True)
class TrackRows:
    """Rows with one time and one id each, in any order, in SI units and radians.

    Optional columns are None if the file does not have them. Missing values of single rows are NaN or an empty text.
    """

    id: Sequence[str]
    """``(rows,)`` name of the row's object."""
    time: Array
    """``(rows,)`` time, s after ``start``."""
    px: Array
    """``(rows,)`` x of the body's centre in the fixed frame, m."""
    py: Array
    """``(rows,)`` y of the body's centre, m; the frame is right-handed, seen from above."""
    vx: Array | None = None
    """``(rows,)`` velocity along x in the fixed frame, m/s."""
    vy: Array | None = None
    heading: Array | None = None
    """``(rows,)`` heading, rad, counter-clockwise from x."""
    speed: Array | None = None
    """``(rows,)`` speed, m/s, if the file has a speed instead of vx and vy."""
    covariance: Array | None = None
    """``(4, 4, rows)`` covariance of px, py, vx, vy; NaN for missing entries."""
    existence: Array | None = None
    """``(rows,)`` probability that the object exists."""
    length: Array | None = None
    width: Array | None = None
    kind: Sequence[str] | None = None
    """``(rows,)`` class, such as car, in the file's own words."""
    dont_care: Mask | None = None
    """``(rows,)`` True for don't-care boxes, which are no objects: a track on such a box is neither right nor false."""
    scene: Sequence[str] | None = None
    """``(rows,)`` name of the scene in trackbench, for tracks made from exported scans."""
    run: Sequence[str] | None = None
    """``(rows,)`` number of the run within its scene, for tracks made from exported scans."""
    fingerprint: Sequence[str] | None = None
    """``(rows,)`` hash of the run's measurements, for tracks made from exported scans."""
    start: Decimal = Decimal(0)
    """Reading of the file's clock at time 0, s; a Decimal, so that nanoseconds since 1970 stay exact."""

    def __len__(self) -> int:
        return len(self.time)

    @property
    def velocity(self) -> tuple[Array | None, Array | None]:
        """Velocities vx and vy, as stated or from speed and heading; None, None if the file has neither."""
        if self.vx is None and self.speed is not None and self.heading is not None:
            return self.speed * np.cos(self.heading), self.speed * np.sin(self.heading)
        return self.vx, self.vy

    def require_possible(self, file: Path) -> None:
        """Raise an error if the rows have implausible values.

        Raises:
            InputError: there is no row, or a name, a number or the duration is implausible.
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
        if (length_s := float(np.ptp(self.time))) > jumps.LONGEST:
            raise InputError(f"its last row is {jumps.why_too_long(length_s)}", file=file)

    def rows(self, numbers: Indices) -> Self:
        """Return the rows with the indices ``numbers``, in the order of ``numbers``."""
        columns: dict[str, Any] = {}
        for name in (item.name for item in fields(self)):
            value = getattr(self, name)
            if isinstance(value, np.ndarray):
                columns[name] = value[..., numbers]
            elif isinstance(value, Sequence):
                columns[name] = [value[row] for row in numbers.tolist()]
        return replace(self, **columns)

    def ordered(self, file: Path) -> Self:
        """Return the rows sorted by time.

        Raises:
            InputError: a value is implausible, or an id has two rows at one time in one run.
        """
        self.require_possible(file)
        keys = [self.id, *(column for column in (self.scene, self.run) if column is not None)]
        owner = np.unique([np.unique(key, return_inverse=True)[1] for key in keys], axis=1, return_inverse=True)[1]
        by_owner = np.lexsort((self.time, owner))
        is_repeated = (np.diff(owner[by_owner]) == 0) & (np.diff(self.time[by_owner]) == 0)
        if is_repeated.any():
            row = int(by_owner[int(np.argmax(is_repeated))])
            raise InputError(f"{self.id[row]} has two rows at {self.time[row]:.9g} s", file=file)
        return self.rows(np.argsort(self.time, kind="stable"))


class TrafficTrack(NamedTuple):
    """Track of one body of recorded traffic as stated in a file, in SI units and radians."""

    id: str
    time: Array
    """``(rows,)`` times, s, strictly increasing."""
    x: Array
    """``(rows,)`` x of the body's centre, m."""
    y: Array
    """``(rows,)`` y of the body's centre, m; the frame is right-handed, seen from above."""
    heading: Array | None = None
    """``(rows,)`` heading, rad; None if the file has none: the direction of motion is used."""
    speed: Array | None = None
    """``(rows,)`` speed, m/s; None if the file has none: displacement over time is used."""
    length: float | None = None
    """Length of the body, m; None if the file has none."""
    width: float | None = None
    """Width of the body, m; None if the file has none."""
    kind: str = ""
    """Class, such as car, in the file's own words."""
    vx: Array | None = None
    """``(rows,)`` velocity along x, m/s; None if the file has neither a velocity nor speed and heading."""
    vy: Array | None = None


class TrafficFormat(Config, ABC):
    """File format of recorded traffic. The fields of a subclass are its options in a scenario."""

    endings: ClassVar[tuple[str, ...]]
    """Endings of the format's files, such as ``(".csv",)``; empty if the recording comes with the package."""
    simultaneous: ClassVar[bool] = True
    """Whether the vehicles of a file drove at the same time."""
    from_sensor: ClassVar[bool] = False
    """Whether positions in the file are relative to the sensor, so that the observer stands at the origin."""

    def __hash__(self) -> int:
        return hash((type(self), self.model_dump_json()))

    @abstractmethod
    def rows(self, file: Path) -> TrackRows:
        """Return the rows of a file in the file's order.

        Raises:
            InputError: the file cannot be read or is damaged; with its name, and the line of a text file.
        """

    def read(self, file: Path) -> list[TrafficTrack]:
        """Return the tracks of a file, without don't-care boxes.

        Raises:
            InputError: the file cannot be read or is damaged, or a value is implausible.
        """
        rows = self.rows(file)
        return tracks_of_rows(rows if rows.dont_care is None else rows.rows(np.flatnonzero(~rows.dont_care)), file)


#: Formats of recorded traffic by their names in scenarios.
TRAFFIC_FORMATS: Registry[type[TrafficFormat]] = Registry(
    "trackbench.traffic_formats", "format of recorded traffic", lacks_class(TrafficFormat)
)


def read_rows(form: TrafficFormat, file: Path) -> TrackRows:
    """Return all rows of a file in the file's order, from memory if it was read before and is unchanged.

    Raises:
        InputError: the file is damaged.
    """
    file = Path(os.path.normpath(file))
    version = file.stat()
    return _read_rows(form, file, (version.st_mtime_ns, version.st_size))


@lru_cache(maxsize=8)
def _read_rows(form: TrafficFormat, file: Path, _version: tuple[int, int]) -> TrackRows:
    rows = form.rows(file)
    rows.require_possible(file)
    return rows


#: Quantity of each array of ``TrackRows``.
QUANTITIES = {
    "time": "time",
    **dict.fromkeys(("px", "py"), "length"),
    "heading": "angle",
    **dict.fromkeys(("speed", "vx", "vy"), "speed"),
    **dict.fromkeys(("length", "width"), "size"),
}


def tracks_of_rows(rows: TrackRows, file: Path) -> list[TrafficTrack]:
    """Group rows of any order into tracks by id, each with the size and class of its first row.

    A size of 0 means unknown. A column without any value for a track is None in that track.

    Raises:
        InputError: a value or size is implausible, or a body has two rows at one time.
    """
    rows.require_possible(file)
    time = rows.time + float(rows.start)
    speed = rows.speed if rows.vx is None or rows.vy is None else np.hypot(rows.vx, rows.vy)
    names, first, owner = np.unique(np.asarray(rows.id), return_index=True, return_inverse=True)
    order = np.lexsort((time, owner))
    members = np.split(order, np.searchsorted(owner[order], np.arange(1, len(names))))
    tracks = []
    for number in np.argsort(first).tolist():
        track_rows, row, name = members[number], int(first[number]), str(names[number])
        repeated = np.flatnonzero(np.diff(time[track_rows]) <= 0)
        if len(repeated):
            raise InputError(f"{name} has two rows at {time[track_rows][repeated[0]]:g} s", file=file)
        stated = (
            None if column is None or np.isnan(column[track_rows]).all() else column[track_rows]
            for column in (rows.heading, speed, *rows.velocity)
        )
        heading, speeds, *velocity = stated
        for what, values in (("heading", heading), ("speed", speeds)):
            if values is not None and np.isnan(values).any():
                at = time[track_rows][np.isnan(values)][0]
                raise InputError(f"vehicle {name[:20]!r}: {what} is not a finite number at {at:g} s", file=file)
        length, width = (
            None if sizes is None or not sizes[row] > 0 else float(sizes[row]) for sizes in (rows.length, rows.width)
        )
        kind = "" if rows.kind is None else rows.kind[row]
        place = name, time[track_rows], rows.px[track_rows], rows.py[track_rows]
        tracks.append(TrafficTrack(*place, heading, speeds, length, width, kind, *velocity))
    return tracks


def moving_tracks(tracks: Sequence[TrafficTrack], file: Path) -> tuple[list[TrafficTrack], float]:
    """Return the tracks with at least two rows, their times counted from the earliest row, and that row's time, s.

    Raises:
        InputError: no track has two rows.
    """
    moving = [track for track in tracks if len(track.time) > 1]
    if not moving:
        raise InputError("no vehicle has two rows; there is no motion in this file", file=file)
    start = min(float(track.time[0]) for track in moving)
    return [track._replace(time=track.time - start) for track in moving], start
