"""Text files of tracking benchmarks, whose cells stand at fixed places: MOTChallenge, and KITTI.

Sources: Dendorfer et al. (2021), "MOTChallenge: A Benchmark for Single-Camera Multiple Target Tracking", section 3.4,
and the 3D benchmark of 2015, whose x and y are metres on the ground; Geiger, Lenz and Urtasun (2012), "Are we ready for
autonomous driving? The KITTI vision benchmark suite", and the readme.txt of its development kit.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from trackbench.base.config import Positive
from trackbench.base.errors import InputError, counted
from trackbench.base.numbers import stated_number
from trackbench.base.types import Array
from trackbench.base.units import wrap_angle
from trackbench.truth import jumps
from trackbench.truth.recorded.rows import log_text
from trackbench.truth.tracks import RowsFormat, TrackRows


class TextLine(NamedTuple):
    """The cells of a line."""

    number: int
    """From 1."""
    cells: list[str]


def _read_lines(file: Path, separator: str | None, least: int, layout: str) -> list[TextLine]:
    """The lines of a file that are not empty.

    Args:
        file: the file.
        separator: between cells; None: white space.
        least: number of cells of a line; there may be more.
        layout: what they are, for messages.

    Raises:
        InputError: it cannot be read or is empty, or a line has fewer cells.
    """
    lines = []
    for number, text in enumerate(log_text(file).splitlines(), 1):
        if not text.strip():
            continue
        cells = [cell.strip() for cell in text.split(separator)]
        if len(cells) < least:
            message = f"{len(cells)} columns, where {least} are needed: {layout}"
            raise InputError(message, file=file, line=number)
        problem = jumps.why_no_name(cells[1]) or (None if cells[1] else "its id is empty")
        if problem is not None:
            raise InputError(problem, file=file, line=number)
        lines.append(TextLine(number, cells))
    return lines


def _column_numbers(lines: Sequence[TextLine], column: int, file: Path) -> Array:
    """A column of finite numbers, of lengths or smaller ones.

    Raises:
        InputError: a cell is none.
    """
    values = np.empty(len(lines))
    for row, line in enumerate(lines):
        cell = line.cells[column]
        values[row] = stated_number(cell)
        if not abs(values[row]) <= jumps.LARGEST["length"]:
            message = f"column {column + 1} is {cell[:20]!r}, where a number up to {jumps.LARGEST['length']:.0e} is due"
            raise InputError(message, file=file, line=line.number)
    return values


class MotChallenge(RowsFormat):
    """MOTChallenge with positions on the ground: frame, id, left, top, width, height, confidence, x, y, z.

    Of boxes, a confidence of 0 says don't care.
    """

    endings: ClassVar[tuple[str, ...]] = (".txt",)
    rate_hz: Positive = Field(description="Frames per second, Hz; frame 1 is at 0 s.")

    def rows(self, file: Path) -> TrackRows:
        lines = _read_lines(file, ",", 10, "frame, id, left, top, width, height, confidence, x, y, z")
        frame, confidence, x, y = (_column_numbers(lines, column, file) for column in (0, 6, 7, 8))
        if (x == -1).all() and (y == -1).all():
            message = "x and y are -1: these are boxes in the picture, and positions on the ground are scored"
            raise InputError(message, file=file)
        return TrackRows([row.cells[1] for row in lines], (frame - 1) / self.rate_hz, x, y, dont_care=confidence == 0)


FRAME, ID, TYPE, WIDTH, LENGTH, X, Z, ROTATION = 0, 1, 2, 11, 12, 13, 15, 16
COLUMNS = 17
NO_OBJECT = "DontCare"
#: m, in place of a coordinate of what has a box in the picture alone.
NOWHERE = -1000.0


class Kitti(RowsFormat):
    """KITTI tracking: labels, or tracks with a score after them; x is forward and y left of the camera."""

    endings: ClassVar[tuple[str, ...]] = (".txt",)
    from_sensor: ClassVar[bool] = True
    rate_hz: Positive = Field(10, description="Frames per second, Hz; frame 0 is at 0 s.")

    def rows(self, file: Path) -> TrackRows:
        every = _read_lines(file, None, COLUMNS, "frame, id, type and 14 numbers")
        in_picture = [
            line.cells[TYPE] == NO_OBJECT and z == NOWHERE
            for line, z in zip(every, _column_numbers(every, Z, file), strict=True)
        ]
        lines = [line for line, nowhere in zip(every, in_picture, strict=True) if not nowhere]
        if all(line.cells[TYPE] == NO_OBJECT for line in lines):
            raise InputError("there is no object in this file", file=file)
        left_out = f"left out {counted(sum(in_picture), 'DontCare row')} without a place on the ground"

        def column(number: int) -> Array:
            return _column_numbers(lines, number, file)

        # The camera's x points right, y down and z forward; its angle turns from x over -z.
        return TrackRows(
            [line.cells[ID] for line in lines],
            column(FRAME) / self.rate_hz,
            column(Z),
            -column(X),
            heading=np.asarray(wrap_angle(-column(ROTATION) - np.pi / 2)),
            length=column(LENGTH),
            width=column(WIDTH),
            kind=[line.cells[TYPE].lower() for line in lines],
            dont_care=np.array([line.cells[TYPE] == NO_OBJECT for line in lines]),
            notes=(left_out,) if any(in_picture) else (),
        )
