"""Tracks of the MOTChallenge in the plane: lines of frame, id, box in the picture, confidence, x, y, z.

Source: Dendorfer et al. (2021), "MOTChallenge: A Benchmark for Single-Camera Multiple Target Tracking", section 3.4,
and the 3D benchmark of 2015, whose x and y are metres on the ground.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from pydantic import Field

from trackbench.base.config import Positive
from trackbench.base.errors import InputError
from trackbench.truth.formats.lines import numbers_of, read_lines
from trackbench.truth.track_rows import TrackRows
from trackbench.truth.tracks import RowsFormat

FRAME, ID, CONFIDENCE, X, Y = 0, 1, 6, 7, 8
COLUMNS = 10


class MotChallenge(RowsFormat):
    """MOTChallenge with positions on the ground: frame, id, left, top, width, height, confidence, x, y, z."""

    endings: ClassVar[tuple[str, ...]] = (".txt",)
    rate_hz: Positive = Field(description="Frames per second, Hz; frame 1 is at 0 s.")

    def rows(self, file: Path) -> TrackRows:
        lines = read_lines(file, ",", COLUMNS, "frame, id, left, top, width, height, confidence, x, y, z")
        frame, x, y = (numbers_of(lines, column, file) for column in (FRAME, X, Y))
        if (x == -1).all() and (y == -1).all():
            message = "x and y are -1: these are boxes in the picture, and positions on the ground are scored"
            raise InputError(message, file=file)
        return TrackRows([row.cells[ID] for row in lines], (frame - 1) / self.rate_hz, x, y)
