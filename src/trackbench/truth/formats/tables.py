"""Tables of recorded traffic: CSV and Parquet of one's own, and I-80, which comes with the package.

Which column is what is told by usual names and shown; what they leave in doubt is asked for.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from trackbench.base.config import Problem
from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.types import Array
from trackbench.truth import jumps
from trackbench.truth.config.columns import UNITS, Units
from trackbench.truth.formats.geographic import GeographicOrigin
from trackbench.truth.recorded.rows import Rows
from trackbench.truth.recorded.table_files import read_header, read_table
from trackbench.truth.tracks import COVARIANCE, TrackRows, TrafficFormat

#: What cannot be meant: the least, the most, and why.
_NO_SIZE = (np.nextafter(0, 1), np.inf, "which is no size; leave it empty where it is not known")
POSSIBLE = {"length": _NO_SIZE, "width": _NO_SIZE, "existence": (0.0, 1.0, "which is no probability")}


#: What a column may hold, and its quantity; None: it is read as it is.
QUANTITIES: dict[str, str | None] = {
    "time": "time",
    "id": None,
    **dict.fromkeys(("x", "y"), "length"),
    **dict.fromkeys(("vx", "vy"), "speed"),
    "heading": "angle",
    "speed": "speed",
    **dict.fromkeys(("length", "width"), "length"),
    **dict.fromkeys(("class", "existence", "scene", "run", "fingerprint"), None),
    **dict.fromkeys(COVARIANCE, None),
}
REQUIRED = ("time", "id", "x", "y")

#: Names of a position along an axis.
PLACES = ("{}", "p{}", "pos{}", "position{}", "{}pos", "center{}", "centre{}", "{}center", "{}centre", "c{}")


def _pairs(row: int, column: int) -> set[str]:
    """How an entry of a covariance is called: ``xvy``, ``vyx``."""
    a, b = (("x", "y", "vx", "vy")[place] for place in (row, column))
    return {a + b, b + a}


#: Names in lower case, without what stands between their parts and without a unit at their end.
NAMES: dict[str, tuple[str, ...]] = {
    "time": ("time", "t", "timestamp", "stamp", "timesec", "epoch"),
    "id": ("id", "track", "trackid", "tid", "object", "objectid", "objid", "trackuuid", "uuid", "targetid"),
    **{
        axis: (*(word.format(axis) for word in PLACES), compass)
        for axis, compass in (("x", "easting"), ("y", "northing"))
    },
    **{f"v{axis}": (f"v{axis}", f"vel{axis}", f"velocity{axis}", f"{axis}velocity", f"speed{axis}") for axis in "xy"},
    "heading": ("heading", "yaw", "psi", "rotation", "orientation"),
    "speed": ("speed", "v", "velocity"),
    "length": ("length", "len", "l"),
    "width": ("width", "w"),
    "class": ("class", "type", "label", "category", "objectclass", "objecttype", "kind"),
    "existence": ("existence", "existenceprobability", "probabilityofexistence", "pexist"),
    **{key: (key,) for key in ("scene", "run", "fingerprint")},
    **{
        name: (name.replace("_", ""), *(f"{word}{pair}" for word in ("cov", "p") for pair in _pairs(*places)))
        for name, places in COVARIANCE.items()
    },
}
#: Other ways to write a unit.
UNIT_WORDS = {"sec": "s", "seconds": "s", "msec": "ms", "usec": "us", "nsec": "ns", "kmh": "kmph", "kph": "kmph"}


#: Words of the names of columns of degrees, and what may stand beside them there.
LATITUDE, LONGITUDE = {"lat", "latitude"}, {"lon", "lng", "long", "longitude"}
DEGREES = {"x": LONGITUDE, "y": LATITUDE}
BESIDE = {"deg", "degrees", "gps", "wgs84", "pos", "position"}


def _is_degrees(name: str, words: set[str]) -> bool:
    parts = {*_parts(name)}
    return bool(parts & words) and parts <= words | BESIDE


class ColumnLayout(NamedTuple):
    """Where a table has what."""

    columns: Mapping[str, str]
    """The column of each key of ``QUANTITIES`` that the table has."""
    units: Mapping[str, str]
    """By key the unit that the name of its column ends in, or that was stated."""

    @property
    def lines(self) -> list[str]:
        """What is read from where: ``time <- timestamp_ns (ns)``."""
        return [
            f"{key} \N{LEFTWARDS ARROW} {name}" + (f" ({self.units[key]})" if key in self.units else "")
            for key, name in self.columns.items()
            if key != name
        ]

    def factor(self, key: str, default: float) -> float:
        """What a column is multiplied by; ``default`` where its unit is not known from its name."""
        quantity = QUANTITIES[key]
        return default if quantity is None or key not in self.units else UNITS[quantity][self.units[key]]


def column_layout(header: Sequence[str], stated: Mapping[str, str], required: Iterable[str] = REQUIRED) -> ColumnLayout:
    """The layout of a table with these columns.

    Args:
        header: names of all columns.
        stated: the column of some keys, perhaps with its unit after a colon: ``timestamp:ns``.
        required: keys that it must have.

    Raises:
        InputError: a key has several columns, or a required one none; names the candidates.
    """
    columns, units = {}, {}
    for key in QUANTITIES:
        if key in stated:
            name, unit = _named(key, stated[key], header)
        else:
            candidates = [(name, unit) for name in header for known, unit in [_known(name)] if known == key]
            if not candidates and key in DEGREES:
                candidates = [(name, None) for name in header if _is_degrees(name, DEGREES[key])]
            if len(candidates) > 1:
                names = " or ".join(repr(name) for name, _ in candidates)
                raise InputError(f"{key} may be {names}: say which, such as {key}={candidates[0][0]}")
            if not candidates:
                continue
            name, unit = candidates[0]
        columns[key] = name
        if unit is not None:
            units[key] = unit
    for key in required:
        if key not in columns:
            others = [name for name in header if name not in columns.values()]
            none = f"there is no column {key!r}, nor a usual name of it ({', '.join(NAMES[key])})"
            raise InputError(f"{none}; {nearest_choices(key, others or header)}")
    return ColumnLayout(columns, units)


def _named(key: str, stated: str, header: Sequence[str]) -> tuple[str, str | None]:
    name, colon, unit = stated.rpartition(":")
    units = UNITS.get(QUANTITIES[key] or "", {})
    if stated in header or not colon:
        if stated not in header:
            raise InputError(f"there is no column {stated!r} for {key}; {nearest_choices(stated, header)}")
        return stated, _unit(stated, key)
    if name not in header:
        raise InputError(f"there is no column {name!r} for {key}; {nearest_choices(name, header)}")
    if unit not in units:
        raise InputError(f"{unit!r} is no unit of {key}; {nearest_choices(unit, units)}")
    return name, unit


def _parts(name: str) -> list[str]:
    words = name.lower().replace("m/s", "mps").replace("km/h", "kmph").replace("kmps", "kmph")
    return [UNIT_WORDS.get(part, part) for part in re.split(r"[^a-z0-9]+", words) if part]


def _unit(name: str, key: str) -> str | None:
    """The unit of its quantity in which the name of a column ends."""
    parts, units = _parts(name), UNITS.get(QUANTITIES[key] or "", {})
    return parts[-1] if len(parts) > 1 and parts[-1] in units else None


def _known(name: str) -> tuple[str | None, str | None]:
    """What a column of this name holds, and its unit; None where that is not known."""
    parts = _parts(name)
    for key, names in NAMES.items():
        if "".join(parts) in names:
            return key, None
        unit = _unit(name, key)
        if unit is not None and "".join(parts[:-1]) in names:
            return key, unit
    return None, None


def table_rows(rows: Rows, layout: ColumnLayout, factors: Mapping[str, float]) -> TrackRows:
    """The rows of a table of tracks.

    Args:
        rows: of the table.
        layout: where it has what.
        factors: what the columns are multiplied by.

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
    for key, (least, most, why) in POSSIBLE.items():
        if (values := numeric[key]) is not None and (wrong := (values < least) | (values > most)).any():
            row = int(np.argmax(wrong))
            raise rows.error(row, f"{layout.columns[key]} is {values[row]:g}, {why}")
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
        notes=(*layout.lines, *clock.notes),
    )


class TableFormat(TrafficFormat):
    """What CSV and Parquet have in common."""

    form: ClassVar[Literal["csv", "parquet"]]
    columns: dict[str, str] = Field(
        default_factory=dict,
        description="Names of columns that are not called as here: time, id, x, y, vx, vy, heading, speed, length, "
        "width, class. The first four are required; x and y are of the centre of the body. Of tracks, columns are also "
        "known by usual names; further keys are existence, p_00 to p_33 (covariance of x, y, vx, vy), scene, run and "
        "fingerprint.",
    )
    units: Units = Field(default_factory=Units, description="Units of the columns.")
    origin: GeographicOrigin | None = Field(
        None,
        description="Where x and y are longitude and latitude: the point at which a plane touches the ground; x is "
        "then the distance to its east and y to its north, m.",
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
        factors = {key: layout.factor(key, self.units.factor(quantity, None)) for key, quantity in QUANTITIES.items()}
        x, y = layout.columns["x"], layout.columns["y"]
        degrees = _is_degrees(x, LONGITUDE), _is_degrees(y, LATITUDE)
        if _is_degrees(x, LATITUDE) or _is_degrees(y, LONGITUDE) or degrees[0] != degrees[1]:
            message = f"x is {x!r} and y is {y!r}: x is the longitude (east) and y the latitude (north), or neither is"
            raise InputError(message, file=file)
        if all(degrees):
            factors |= {"x": 1.0, "y": 1.0}
        rows = table_rows(read_table(file, self.form, layout.columns.values()), layout, factors)
        if not all(degrees):
            return rows
        if self.origin is None:
            here = f"{{lat_deg: {rows.py[0]:.3f}, lon_deg: {rows.px[0]:.3f}}}"
            message = f"{x!r} and {y!r} are degrees, and metres are scored: state a point nearby as origin, such as "
            raise InputError(f"{message}origin: {here} (score: --origin {rows.py[0]:.3f} {rows.px[0]:.3f})", file=file)
        east, north = self.origin.plane(rows.py, rows.px)
        return replace(rows, px=east, py=north)


class Csv(TableFormat):
    """CSV of your own, a line of column names first: time, id, x, y; heading, speed, length, width, class."""

    endings: ClassVar[tuple[str, ...]] = (".csv",)
    form: ClassVar[Literal["csv", "parquet"]] = "csv"


class Parquet(TableFormat):
    """Parquet of your own, with columns time, id, x, y; heading, speed, length, width, class."""

    endings: ClassVar[tuple[str, ...]] = (".parquet",)
    form: ClassVar[Literal["csv", "parquet"]] = "parquet"


#: Its columns hold integers: ms, mm, 1e-4 rad, mm/s.
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
