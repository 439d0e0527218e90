"""Tables of recorded traffic: the user's CSV and Parquet, and I-80, which comes with the package."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from trackbench.base.config import Problem
from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.types import Array
from trackbench.truth import jumps
from trackbench.truth.config.columns import UNITS, Column, column_in, stated_column
from trackbench.truth.recorded.rows import Rows
from trackbench.truth.recorded.table_files import read_header, read_table
from trackbench.truth.tracks import COVARIANCE, TrackRows, TrafficFormat

#: Keys of columns with their quantities; None for values read without conversion.
QUANTITIES: dict[str, str | None] = {
    "time": "time",
    "id": None,
    **dict.fromkeys(("x", "y"), "length"),
    **dict.fromkeys(("vx", "vy"), "speed"),
    "heading": "angle",
    "speed": "speed",
    **dict.fromkeys(("length", "width"), "size"),
    "existence": "probability",
    **dict.fromkeys(("class", "scene", "run", "fingerprint"), None),
    **dict.fromkeys(COVARIANCE, None),
}
REQUIRED = ("time", "id", "x", "y")

#: Accepted names of columns, without a unit at their end, by key.
NAMES = {
    "t": "time",
    "timestamp": "time",
    **dict.fromkeys(("track", "track_id", "object", "object_id"), "id"),
    **{name.format(axis): axis for axis in "xy" for name in ("p{}", "pos_{}")},
    "yaw": "heading",
    **{key: key for key in QUANTITIES},
}
#: Beginnings of the names of columns in degrees.
DEGREES = ("lon", "long", "longitude", "lat", "latitude")


def column_layout(header: Sequence[str], stated: Mapping[str, str]) -> dict[str, Column]:
    """Find the column of each quantity in a table, by key: time, id, x, y, heading and so on.

    Args:
        header: names of all columns of the table.
        stated: columns named by the user, by key, optionally with a unit after a colon: ``timestamp:ns``.

    Raises:
        InputError: a key has several columns, or a required key none; the message names the candidates.
    """
    columns: dict[str, Column] = {}
    for key, quantity in QUANTITIES.items():
        if key in stated and stated[key] not in header and ":" in stated[key]:
            columns[key] = stated_column(stated[key], quantity)
            continue
        names = [stated[key]] if key in stated else [name for name in header if _key(name) == key]
        if len(names) > 1:
            raise InputError(f"{key} may be {' or '.join(map(repr, names))}; say which")
        if not names and key in REQUIRED:
            raise InputError(f"there is no column {key!r}; {nearest_choices(key, header)}")
        for name in names:
            columns[key] = column_in(name, quantity, _ending(name))
    return columns


def _ending(name: str) -> str:
    return name.lower().rpartition("_")[2]


def _key(name: str) -> str | None:
    """Return the key that a column's name tells, such as x for ``pos_x_km``; None for an unknown name."""
    word = name.lower()
    key = NAMES.get(word.rpartition("_")[0])
    has_unit = key is not None and _ending(word) in UNITS.get(QUANTITIES[key] or "", {})
    return NAMES.get(word, key if has_unit else None)


def table_rows(rows: Rows, layout: Mapping[str, Column]) -> TrackRows:
    """Return a table of tracks as rows in SI units.

    Args:
        rows: the table as read from the file.
        layout: column of each quantity, by key.

    Raises:
        InputError: a row is damaged.
    """

    def numbers(key: str) -> Array | None:
        return rows.numbers(layout[key], optional=key not in REQUIRED) if key in layout else None

    def texts(key: str) -> list[str] | None:
        return rows.texts(layout[key].name) if key in layout else None

    clock = rows.times(layout["time"])
    latest, length_s = int(np.argmax(clock.seconds)), float(np.ptp(clock.seconds))
    if length_s > jumps.LONGEST:
        column = layout["time"].name
        raise rows.error(latest, f"{column}: {jumps.why_too_long(length_s)}, such as time={column}:ns")
    covariance = None
    if any(key in layout for key in COVARIANCE):
        covariance = np.full((4, 4, len(rows)), np.nan)
        for key, (a, b) in COVARIANCE.items():
            values = numbers(key)
            if values is not None:
                covariance[a, b] = covariance[b, a] = values
    numeric: dict[str, Any] = {
        key: numbers(key) for key in ("x", "y", "vx", "vy", "heading", "speed", "length", "width", "existence")
    }
    named: dict[str, Any] = {key: texts(key) for key in ("scene", "run", "fingerprint")}
    return TrackRows(
        rows.labels(layout["id"].name).of_rows,
        clock.seconds,
        numeric.pop("x"),
        numeric.pop("y"),
        **numeric,
        covariance=covariance,
        kind=texts("class"),
        **named,
        start=clock.start,
    )


class TableFormat(TrafficFormat):
    """Common reader of CSV and Parquet files with one row for each time and object."""

    form: ClassVar[Literal["csv", "parquet"]]
    columns: dict[str, str] = Field(
        default_factory=dict,
        description="Names of columns that are not called as here: time, id, x, y, vx, vy, heading, speed, length, "
        "width, class. The first four are required; x and y are of the centre of the body. Further keys are existence, "
        "p_00 to p_33 (covariance of x, y, vx, vy), scene, run and fingerprint. A unit may stand after a name, as in "
        "`heading: yaw:deg`, or at the end of a name in the file, as in `x_km`.",
    )

    def problems(self) -> Iterator[Problem]:
        for key in self.columns:
            if key not in QUANTITIES:
                yield Problem(("columns", key), f"no column of traffic; {nearest_choices(key, QUANTITIES)}")

    def rows(self, file: Path) -> TrackRows:
        try:
            layout = column_layout(read_header(file, self.form), self.columns)
        except InputError as error:
            raise error.located(file=file, line=None) from None
        table = read_table(file, self.form, (column.name for column in layout.values()))
        for column in (layout[key].name for key in ("x", "y")):
            if column.lower().split("_")[0] in DEGREES:
                message = "is in degrees, and metres are scored: project it first, such as by pymap3d.geodetic2enu"
                raise InputError(f"{column!r} {message}", file=file)
        return table_rows(table, layout)


class Csv(TableFormat):
    """CSV of your own, a line of column names first: time, id, x, y; heading, speed, length, width, class."""

    endings: ClassVar[tuple[str, ...]] = (".csv",)
    form: ClassVar[Literal["csv", "parquet"]] = "csv"


class Parquet(TableFormat):
    """Parquet of your own, with columns time, id, x, y; heading, speed, length, width, class."""

    endings: ClassVar[tuple[str, ...]] = (".parquet",)
    form: ClassVar[Literal["csv", "parquet"]] = "parquet"


#: Recording of I-80, with integer columns in ms, mm, 1e-4 rad and mm/s.
I80_FILE = Path(__file__).parent / "i80.parquet"
I80_FACTORS = {**dict.fromkeys(("time", "x", "y", "speed", "length", "width"), 1e-3), "heading": 1e-4}


class InterstateI80(TrafficFormat):
    """NGSIM I-80, which comes with the package: 200 vehicles, 10 s of each. No path is needed."""

    endings: ClassVar[tuple[str, ...]] = ()
    simultaneous: ClassVar[bool] = False

    def rows(self, file: Path) -> TrackRows:
        names = read_header(I80_FILE, "parquet")
        layout = {name: Column(name, QUANTITIES[name], factor=I80_FACTORS.get(name, 1.0)) for name in names}
        return table_rows(read_table(I80_FILE, "parquet", names), layout)
