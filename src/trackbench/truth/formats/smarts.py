"""Traffic histories of SMARTS: an SQLite database.

Source: huawei-noah/SMARTS, ``smarts/sstudio/genhistories.py``.
"""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from trackbench.base.databases import open_tables
from trackbench.base.errors import InputError
from trackbench.truth.tracks import MOST_ROWS, RowsFormat, TrackRows

STATES = "vehicle_id, sim_time, position_x, position_y, heading_rad, speed"
#: Of a vehicle in NGSIM, which SMARTS keeps; a size that it does not know is 0 or NULL.
KINDS = {1: "motorcycle", 2: "car", 3: "truck"}


class Smarts(RowsFormat):
    """SMARTS traffic history, an SQLite database (.shf) of NGSIM, INTERACTION or other traffic."""

    endings: ClassVar[tuple[str, ...]] = (".shf",)

    def rows(self, file: Path) -> TrackRows:
        database = open_tables(file)
        # A row takes some bytes: of a file that names one page again and again, no more than its bytes are read.
        most = min(MOST_ROWS, file.stat().st_size)
        try:
            found = database.execute(f"SELECT {STATES} FROM Trajectory").fetchmany(most)
            if not found:
                raise InputError("there is no vehicle in this file", file=file)
            bodies = database.execute("SELECT id, COALESCE(length, 0), COALESCE(width, 0), type FROM Vehicle")
            by_id = {number: body for number, *body in bodies.fetchmany(most)}
            *numeric, kinds = zip(*((*row, *by_id.get(row[0], (0, 0, 0))) for row in found), strict=True)
            owner, time, x, y, heading, speed, length, width = map(_numbers, numeric)
            ids = [str(int(number)) for number in owner.tolist()]
        except (sqlite3.Error, ValueError, TypeError, OverflowError) as error:
            raise InputError(f"not a traffic history that can be read: {error}", file=file) from None
        finally:
            database.close()
        # SMARTS counts headings from +y.
        return TrackRows(
            ids,
            time,
            x,
            y,
            heading=heading + np.pi / 2,
            speed=speed,
            length=length,
            width=width,
            kind=[KINDS.get(kind, "") for kind in kinds],
        )


def _numbers(column: tuple[Any, ...]) -> Any:
    if not all(isinstance(value, int | float) for value in column):
        raise ValueError("a number is missing, or is text")
    return np.array(column, dtype=float)
