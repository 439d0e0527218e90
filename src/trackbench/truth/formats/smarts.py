"""Traffic histories of SMARTS: an SQLite database.

Source: huawei-noah/SMARTS, ``smarts/sstudio/genhistories.py``.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import ClassVar
from urllib.parse import quote

import numpy as np

from trackbench.base.errors import InputError
from trackbench.base.files import require_regular
from trackbench.truth.tracks import TrackRows, TrafficFormat

STATES = """SELECT vehicle_id, sim_time, position_x, position_y, heading_rad, speed,
COALESCE(length, 0), COALESCE(width, 0), type FROM Trajectory LEFT JOIN Vehicle ON Vehicle.id = vehicle_id"""
#: Classes of NGSIM, which SMARTS keeps. An unknown size is 0 or NULL.
KINDS = {1: "motorcycle", 2: "car", 3: "truck"}


class Smarts(TrafficFormat):
    """SMARTS traffic history, an SQLite database (.shf) of NGSIM, INTERACTION or other traffic."""

    endings: ClassVar[tuple[str, ...]] = (".shf",)

    def rows(self, file: Path) -> TrackRows:
        require_regular(file)
        try:
            with closing(sqlite3.connect(f"file:{quote(str(file.resolve()))}?mode=ro", uri=True)) as database:
                # Limited by the size of the file, since a damaged file may repeat a page endlessly.
                states = database.execute(STATES).fetchmany(file.stat().st_size)
            if not states:
                raise InputError("there is no vehicle in this file", file=file)
            *numeric, kinds = zip(*states, strict=True)
            owner, time, x, y, heading, speed, length, width = np.array(numeric, dtype=float)
            ids = [str(int(number)) for number in owner.tolist()]
        except (sqlite3.Error, ValueError, TypeError, OverflowError) as error:
            raise InputError(f"not a traffic history that can be read: {error}", file=file) from None
        # SMARTS counts headings from +y.
        motion = {"heading": heading + np.pi / 2, "speed": speed, "length": length, "width": width}
        return TrackRows(ids, time, x, y, **motion, kind=[KINDS.get(kind, "") for kind in kinds])
