"""Traffic histories of SMARTS: an SQLite database.

Source: huawei-noah/SMARTS, ``smarts/sstudio/genhistories.py``.
"""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import quote

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.files import require_regular
from trackbench.truth.tracks import MOST_ROWS, RowsFormat, TrackRows

#: Of a vehicle in NGSIM, which SMARTS keeps; a size that it does not know is 0 or NULL.
KINDS = {1: "motorcycle", 2: "car", 3: "truck"}


class Smarts(RowsFormat):
    """SMARTS traffic history, an SQLite database (.shf) of NGSIM, INTERACTION or other traffic."""

    endings: ClassVar[tuple[str, ...]] = (".shf",)

    def rows(self, file: Path) -> TrackRows:
        require_regular(file)
        address = f"file:{quote(str(file.resolve()))}?mode=ro&immutable=1"
        try:
            database = sqlite3.connect(address, uri=True)
        except sqlite3.Error as error:
            raise InputError(f"not a traffic history: {error}", file=file) from None
        try:
            rows = database.execute(
                "SELECT vehicle_id, sim_time, position_x, position_y, heading_rad, speed, COALESCE(length, 0), "
                "COALESCE(width, 0), type FROM Trajectory LEFT JOIN Vehicle ON vehicle_id = Vehicle.id"
            ).fetchmany(MOST_ROWS)
            if not rows:
                raise InputError("there is no vehicle in this file", file=file)
            *columns, kinds = zip(*rows, strict=True)
            owner, time, x, y, heading, speed, length, width = map(_numbers, columns)
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
