"""Text files of the tracking benchmarks MOTChallenge and KITTI, with cells at fixed places.

Sources: Dendorfer et al. (2021), "MOTChallenge: A Benchmark for Single-Camera Multiple Target Tracking", section 3.4,
and the 3D benchmark of 2015, whose x and y are metres on the ground; Geiger, Lenz and Urtasun (2012), "Are we ready for
autonomous driving? The KITTI vision benchmark suite", and the readme.txt of its development kit.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base.config import Positive
from trackbench.base.errors import InputError
from trackbench.base.types import Array
from trackbench.base.units import wrap_angle
from trackbench.truth.config.columns import Column
from trackbench.truth.recorded.rows import Rows, rows_of_columns
from trackbench.truth.recorded.table_files import log_text
from trackbench.truth.tracks import TrackRows, TrafficFormat


def _read_cells(file: Path, separator: str | None, layout: Sequence[str]) -> Rows:
    """Return the cells of all lines that are not empty, as columns "column 1" and so on; ``layout``: their meanings."""
    lines = [(number, text) for number, text in enumerate(log_text(file).splitlines(), 1) if text.strip()]
    cells = [text.split(separator) for _, text in lines]
    for (number, _), row in zip(lines, cells, strict=True):
        if len(row) < len(layout):
            message = f"{len(row)} columns, where {len(layout)} are needed: {', '.join(layout)}"
            raise InputError(message, file=file, line=number)
    columns = {_name(place): [row[place] for row in cells] for place in range(len(layout))}
    return rows_of_columns(file, columns, [number for number, _ in lines])


def _name(place: int) -> str:
    return f"column {place + 1}"


def _lengths(rows: Rows, *places: int) -> list[Array]:
    return [rows.numbers(Column(_name(place), "length")) for place in places]


MOT_COLUMNS = ("frame", "id", "left", "top", "width", "height", "confidence", "x", "y", "z")


class MotChallenge(TrafficFormat):
    """MOTChallenge with positions on the ground: frame, id, left, top, width, height, confidence, x, y, z.

    A box with confidence 0 is a don't-care box.
    """

    endings: ClassVar[tuple[str, ...]] = (".txt",)
    rate_hz: Positive = Field(description="Frames per second, Hz; frame 1 is at 0 s.")

    def rows(self, file: Path) -> TrackRows:
        rows = _read_cells(file, ",", MOT_COLUMNS)
        frame, confidence, x, y = _lengths(rows, 0, 6, 7, 8)
        if (x == -1).all() and (y == -1).all():
            message = "x and y are -1: these are boxes in the picture, and positions on the ground are scored"
            raise InputError(message, file=file)
        ids = rows.labels(_name(1)).of_rows
        return TrackRows(ids, (frame - 1) / self.rate_hz, x, y, dont_care=confidence == 0)


FRAME, ID, TYPE, WIDTH, LENGTH, X, Z, ROTATION = 0, 1, 2, 11, 12, 13, 15, 16
KITTI_COLUMNS = ("frame", "id", "type", *(f"number {place}" for place in range(1, 15)))
NO_OBJECT = "DontCare"
#: Coordinate of an entry that has a box in the picture only, m.
NOWHERE = -1000.0


class Kitti(TrafficFormat):
    """KITTI tracking: labels, or tracks with a score after them; x is forward and y left of the camera."""

    endings: ClassVar[tuple[str, ...]] = (".txt",)
    from_sensor: ClassVar[bool] = True
    rate_hz: Positive = Field(10, description="Frames per second, Hz; frame 0 is at 0 s.")

    def rows(self, file: Path) -> TrackRows:
        all_rows = _read_cells(file, None, KITTI_COLUMNS)
        (ahead,) = _lengths(all_rows, Z)
        is_in_picture = (np.array(all_rows.texts(_name(TYPE))) == NO_OBJECT) & (ahead == NOWHERE)
        rows = all_rows.only(~is_in_picture)
        kinds = rows.texts(_name(TYPE))
        dont_care = np.array([kind == NO_OBJECT for kind in kinds], dtype=bool)
        if dont_care.all():
            raise InputError("there is no object in this file", file=file)
        frame, x, z, turn, length, width = _lengths(rows, FRAME, X, Z, ROTATION, LENGTH, WIDTH)
        # The camera's x points right, y down and z forward; its angle turns from x over -z.
        return TrackRows(
            rows.labels(_name(ID)).of_rows,
            frame / self.rate_hz,
            z,
            -x,
            heading=np.asarray(wrap_angle(-turn - np.pi / 2)),
            length=length,
            width=width,
            kind=[kind.lower() for kind in kinds],
            dont_care=dont_care,
        )
