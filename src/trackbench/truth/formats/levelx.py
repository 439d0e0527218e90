"""Drone recordings of levelX (highD, inD, rounD, exiD): a table of tracks with two tables of meta data.

Sources: Krajewski et al. (2018), "The highD Dataset"; Bock et al. (2020), "The inD Dataset"; Krajewski et al. (2020),
"The rounD Dataset"; Moers et al. (2022), "The exiD Dataset"; and the descriptions of the columns on levelxdata.com.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from trackbench.base.errors import InputError
from trackbench.truth.config.columns import Column, stated_column
from trackbench.truth.recorded.table_files import read_table
from trackbench.truth.tracks import TrackRows, TrafficFormat

TRACKS, RECORDING, BODIES = "_tracks.csv", "_recordingMeta.csv", "_tracksMeta.csv"


class _LevelX(TrafficFormat):
    """Common reader of the recordings of levelX."""

    endings: ClassVar[tuple[str, ...]] = (TRACKS,)
    id_column: ClassVar[str] = "trackId"
    x_column: ClassVar[str] = "xCenter"
    y_column: ClassVar[str] = "yCenter"
    #: Columns of length and width in the table of tracks.
    size_columns: ClassVar[tuple[str, str]] = ("length", "width")
    from_above: ClassVar[bool] = True
    """Whether x and y are the centre in a frame seen from above; in highD they are a corner in the picture."""

    def rows(self, file: Path) -> TrackRows:
        if not file.name.endswith(TRACKS):
            raise InputError(f"the file of the tracks is needed, whose name ends in {TRACKS}", file=file)
        recording = read_table(_neighbour_file(file, RECORDING), "csv", ["frameRate"])
        rate = float(recording.numbers(Column("frameRate"))[0])
        motion = (self.x_column, self.y_column, "xVelocity", "yVelocity")
        heading = ("heading",) if self.from_above else ()
        rows = read_table(file, "csv", ["frame", self.id_column, *motion, *heading, *self.size_columns])
        ids = rows.labels(self.id_column).of_rows
        quantities = ("length", "length", "speed", "speed")
        x, y, vx, vy = (rows.numbers(Column(name, kind)) for name, kind in zip(motion, quantities, strict=True))
        length, width = (rows.numbers(Column(name, "length"), optional=True) for name in self.size_columns)
        # The sides of highD's boxes lie along the picture's axes; its y points down.
        px, py = (x, y) if self.from_above else (x + length / 2, -(y + width / 2))
        bodies = read_table(_neighbour_file(file, BODIES), "csv", [self.id_column, "class"])
        kinds = dict(zip(bodies.texts(self.id_column), bodies.texts("class"), strict=True))
        return TrackRows(
            ids,
            rows.numbers(Column("frame", factor=1.0 / rate)),
            px,
            py,
            heading=rows.numbers(stated_column("heading:deg", "angle")) if self.from_above else None,
            speed=np.hypot(vx, vy),
            length=length,
            width=width,
            kind=[kinds.get(name, "") for name in ids],
        )


def _neighbour_file(file: Path, ending: str) -> Path:
    path = file.with_name(file.name.removesuffix(TRACKS) + ending)
    if not path.is_file():
        raise InputError(f"there is no file {path.name} beside it", file=file)
    return path


class HighD(_LevelX):
    """highD of levelX: NN_tracks.csv, with NN_tracksMeta.csv and NN_recordingMeta.csv beside it."""

    id_column: ClassVar[str] = "id"
    x_column: ClassVar[str] = "x"
    y_column: ClassVar[str] = "y"
    size_columns: ClassVar[tuple[str, str]] = ("width", "height")
    from_above: ClassVar[bool] = False


class InD(_LevelX):
    """inD of levelX: NN_tracks.csv, with NN_tracksMeta.csv and NN_recordingMeta.csv beside it."""


class RounD(_LevelX):
    """rounD of levelX: NN_tracks.csv, with NN_tracksMeta.csv and NN_recordingMeta.csv beside it."""


class ExiD(_LevelX):
    """exiD of levelX: NN_tracks.csv, with NN_tracksMeta.csv and NN_recordingMeta.csv beside it."""
