"""Tables of recorded traffic: the user's CSV and Parquet, and I-80, which comes with the package."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from trackbench.base.config import Problem
from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.types import Array
from trackbench.truth import jumps
from trackbench.truth.config.columns import UNITS, Units
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


class ColumnLayout(NamedTuple):
    """Which column of a table holds which quantity, and in which unit."""

    columns: Mapping[str, str]
    """Name of the column in the table, by key: time, id, x, y, heading and so on."""
    units: Mapping[str, str]
    """Unit of a column, by key: stated by the user, or the ending of the column's name."""

    def factor(self, key: str, default: float) -> float:
        """Return the factor from the unit of a key's column to SI units; ``default`` if the unit is unknown."""
        quantity = QUANTITIES[key]
        return default if quantity is None or key not in self.units else UNITS[quantity][self.units[key]]


def column_layout(header: Sequence[str], stated: Mapping[str, str]) -> ColumnLayout:
    """Find the column and unit of each quantity in a table.

    Args:
        header: names of all columns of the table.
        stated: columns named by the user, by key, optionally with a unit after a colon: ``timestamp:ns``.

    Raises:
        InputError: a key has several columns, or a required key none; the message names the candidates.
    """
    columns: dict[str, str] = {}
    units: dict[str, str] = {}
    for key in QUANTITIES:
        candidates = [(name, unit) for name in header for known, unit in [_known(name)] if known == key]
        if key in stated:
            candidates = [_named(key, stated[key], header)]
        if len(candidates) > 1:
            names = " or ".join(repr(name) for name, _ in candidates)
            raise InputError(f"{key} may be {names}; say which")
        if not candidates and key in REQUIRED:
            raise InputError(f"there is no column {key!r}; {nearest_choices(key, header)}")
        for name, unit in candidates:
            columns[key] = name
            units |= {key: unit} if unit is not None else {}
    return ColumnLayout(columns, units)


def _named(key: str, stated: str, header: Sequence[str]) -> tuple[str, str | None]:
    name, colon, unit = stated.rpartition(":")
    if stated in header or not colon:
        name, unit = stated, _unit(stated, key) or ""
    if name not in header:
        raise InputError(f"there is no column {name!r} for {key}; {nearest_choices(name, header)}")
    units = UNITS.get(QUANTITIES[key] or "", {})
    if unit and unit not in units:
        raise InputError(f"{unit!r} is no unit of {key}; {nearest_choices(unit, units)}")
    return name, unit or None


def _unit(name: str, key: str) -> str | None:
    """Return the unit at the end of a column's name if it is one of the key's quantity, else None."""
    _, bar, unit = name.lower().rpartition("_")
    return unit if bar and unit in UNITS.get(QUANTITIES[key] or "", {}) else None


def _known(name: str) -> tuple[str | None, str | None]:
    """Return the key and the unit that a column's name tells; None for each that it does not."""
    word = name.lower()
    key = NAMES.get(word) or NAMES.get(word.rpartition("_")[0])
    unit = None if key is None or word in NAMES else _unit(word, key)
    return (key, unit) if word in NAMES or unit is not None else (None, None)


def table_rows(rows: Rows, layout: ColumnLayout, factors: Mapping[str, float]) -> TrackRows:
    """Return a table of tracks as rows in SI units.

    Args:
        rows: the table as read from the file.
        layout: column and unit of each quantity.
        factors: factor from the unit of each column to SI units, by key.

    Raises:
        InputError: a row is damaged.
    """

    def numbers(key: str) -> Array | None:
        if key not in layout.columns:
            return None
        optional = key not in REQUIRED
        return rows.numbers(layout.columns[key], factors[key], QUANTITIES[key], optional=optional)

    def texts(key: str) -> list[str] | None:
        return rows.texts(layout.columns[key]) if key in layout.columns else None

    clock = rows.times(layout.columns["time"], factors["time"])
    latest, length_s = int(np.argmax(clock.seconds)), float(np.ptp(clock.seconds))
    if length_s > jumps.LONGEST:
        column = layout.columns["time"]
        raise rows.error(latest, f"{column}: {jumps.why_too_long(length_s)}, such as time={column}:ns")
    covariance = None
    if any(key in layout.columns for key in COVARIANCE):
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
        rows.labels(layout.columns["id"]).of_rows,
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
        "p_00 to p_33 (covariance of x, y, vx, vy), scene, run and fingerprint.",
    )
    units: Units = Field(default_factory=Units, description="Units of the columns.")

    def problems(self) -> Iterator[Problem]:
        for key in self.columns:
            if key not in QUANTITIES:
                yield Problem(("columns", key), f"no column of traffic; {nearest_choices(key, QUANTITIES)}")

    def rows(self, file: Path) -> TrackRows:
        try:
            layout = column_layout(read_header(file, self.form), self.columns)
        except InputError as error:
            raise error.located(file=file, line=None) from None
        factors = {key: layout.factor(key, self.units.factor(quantity, None)) for key, quantity in QUANTITIES.items()}
        table = read_table(file, self.form, layout.columns.values())
        for column in (layout.columns[key] for key in ("x", "y")):
            if column.lower().split("_")[0] in DEGREES:
                message = "is in degrees, and metres are scored: project it first, such as by pymap3d.geodetic2enu"
                raise InputError(f"{column!r} {message}", file=file)
        return table_rows(table, layout, factors)


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
        factors = {**dict.fromkeys(QUANTITIES, 1.0), **I80_FACTORS}
        return table_rows(
            read_table(I80_FILE, "parquet", names), ColumnLayout({name: name for name in names}, {}), factors
        )
