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
from trackbench.truth.tracks import MOST_ROWS, TrafficFormat, TrafficTrack, tracks_of

#: Of a vehicle in NGSIM, which SMARTS keeps.
KINDS = {1: "motorcycle", 2: "car", 3: "truck"}


class Smarts(TrafficFormat):
    """SMARTS traffic history, an SQLite database (.shf) of NGSIM, INTERACTION or other traffic."""

    endings: ClassVar[tuple[str, ...]] = (".shf",)

    def read(self, file: Path) -> list[TrafficTrack]:
        require_regular(file)
        address = f"file:{quote(str(file.resolve()))}?mode=ro&immutable=1"
        try:
            database = sqlite3.connect(address, uri=True)
        except sqlite3.Error as error:
            raise InputError(f"not a traffic history: {error}", file=file) from None
        try:
            vehicles = database.execute("SELECT id, type, length, width FROM Vehicle").fetchmany(MOST_ROWS)
            rows = database.execute(
                "SELECT vehicle_id, sim_time, position_x, position_y, heading_rad, speed FROM Trajectory"
            ).fetchmany(MOST_ROWS)
            bodies = {str(int(row[0])): _body(row) for row in vehicles}
            if not rows:
                raise InputError("there is no vehicle in this file", file=file)
            owner, time, x, y, heading, speed = (_numbers(column) for column in zip(*rows, strict=True))
            ids = [str(int(number)) for number in owner.tolist()]
        except (sqlite3.Error, ValueError, TypeError, OverflowError) as error:
            raise InputError(f"not a traffic history that can be read: {error}", file=file) from None
        finally:
            database.close()
        # SMARTS counts headings from +y.
        columns = {"time": time, "x": x, "y": y, "heading": heading + np.pi / 2, "speed": speed}
        return tracks_of(file, ids, columns, bodies)


def _numbers(column: tuple[Any, ...]) -> Any:
    if not all(isinstance(value, int | float) for value in column):
        raise ValueError("a number is missing, or is text")
    return np.array(column, dtype=float)


def _body(row: tuple[Any, ...]) -> dict[str, Any]:
    """Size and class of a vehicle; a size that is not known is 0 or NULL."""
    length, width = (None if value in (None, 0) else float(value) for value in row[2:4])
    return {"length": length, "width": width, "kind": KINDS.get(row[1], "")}
