"""Labels and tracks of KITTI's tracking benchmark, in the plane of the camera.

Source: Geiger, Lenz and Urtasun (2012), "Are we ready for autonomous driving? The KITTI vision benchmark suite",
and the readme.txt of its development kit.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field

from trackbench.base.config import Positive
from trackbench.base.errors import InputError
from trackbench.base.types import Array
from trackbench.base.units import wrap_angle
from trackbench.truth.formats.lines import numbers_of, read_lines
from trackbench.truth.track_rows import TrackRows
from trackbench.truth.tracks import RowsFormat

FRAME, ID, TYPE, WIDTH, LENGTH, X, Z, ROTATION = 0, 1, 2, 11, 12, 13, 15, 16
COLUMNS = 17
NO_OBJECT = "DontCare"


class Kitti(RowsFormat):
    """KITTI tracking: labels, or tracks with a score after them; x is forward and y left of the camera."""

    endings: ClassVar[tuple[str, ...]] = (".txt",)
    rate_hz: Positive = Field(10, description="Frames per second, Hz; frame 0 is at 0 s.")

    def rows(self, file: Path) -> TrackRows:
        every = read_lines(file, None, COLUMNS, "frame, id, type and 14 numbers")
        lines = [line for line in every if line.cells[TYPE] != NO_OBJECT]
        if not lines:
            raise InputError("there is no object in this file", file=file)

        def column(number: int) -> Array:
            return numbers_of(lines, number, file)

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
        )
