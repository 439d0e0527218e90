"""Tables of recorded traffic: CSV and Parquet of one's own, and I-80, which comes with the package."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import Field

from trackbench.base.config import Problem
from trackbench.base.errors import nearest
from trackbench.base.types import Array
from trackbench.truth.config.columns import Units
from trackbench.truth.recorded.rows import read
from trackbench.truth.tracks import TrafficFormat, TrafficTrack, tracks_of

#: The columns of a table and the quantity in each; None: it is read as it is.
QUANTITIES: dict[str, str | None] = {
    "time": "time",
    "id": None,
    **dict.fromkeys(("x", "y"), "length"),
    "heading": "angle",
    "speed": "speed",
    **dict.fromkeys(("length", "width"), "length"),
    "class": None,
}
REQUIRED = ("time", "id", "x", "y")
#: What a table says once of each body.
OF_BODY = {"length": "length", "width": "width", "class": "kind"}


def tracks(
    file: Path, form: str, names: Mapping[str, str], factors: Mapping[str, float], stated: frozenset[str] = frozenset()
) -> list[TrafficTrack]:
    """The tracks of a table.

    Args:
        file: the table.
        form: "csv" or "parquet".
        names: the table's column for each key of ``QUANTITIES``.
        factors: what the columns of some keys are multiplied by; 1 unless given.
        stated: keys whose columns the table must have, beside ``REQUIRED``.

    Raises:
        InputError: the file cannot be read, lacks a column or has a damaged row.
    """
    needed = [key for key in names if key in REQUIRED or key in stated]
    rows = read(file, form, [names[key] for key in needed], names.values())
    ids = rows.names(names["id"])
    known = {key: name for key, name in names.items() if name in rows.columns}
    columns: dict[str, Array] = {
        key: rows.numbers(name, factors.get(key, 1.0), None if QUANTITIES[key] == "time" else QUANTITIES[key])
        for key, name in known.items()
        if key not in OF_BODY and key != "id"
    }
    first = {name: row for row, name in reversed([*enumerate(ids)])}
    bodies: dict[str, dict[str, Any]] = {name: {} for name in first}
    for key in ("length", "width"):
        if key in known:
            sizes = rows.numbers(known[key], factors.get(key, 1.0), "length", optional=True)
            for name, row in first.items():
                bodies[name][key] = float(sizes[row]) if sizes[row] > 0 else None
    if "class" in known:
        for name, row in first.items():
            bodies[name]["kind"] = str(rows.columns[known["class"]][row] or "").strip()
    return tracks_of(file, ids, columns, bodies)


class _Table(TrafficFormat):
    """What CSV and Parquet have in common."""

    form: ClassVar[Literal["csv", "parquet"]]
    columns: dict[str, str] = Field(
        default_factory=dict,
        description="Names of columns that are not called as here: time, id, x, y, heading, speed, length, width, "
        "class. The first four are required; x and y are of the centre of the body.",
    )
    units: Units = Field(default_factory=Units, description="Units of the columns.")

    def problems(self) -> Iterator[Problem]:
        for key in self.columns:
            if key not in QUANTITIES:
                yield Problem(("columns", key), f"no column of traffic; {nearest(key, QUANTITIES)}")

    def read(self, file: Path) -> list[TrafficTrack]:
        names = {key: self.columns.get(key, key) for key in QUANTITIES}
        factors = {key: self.units.factor(quantity, None) for key, quantity in QUANTITIES.items()}
        return tracks(file, self.form, names, factors, frozenset(self.columns))


class Csv(_Table):
    """CSV of your own, a line of column names first: time, id, x, y; heading, speed, length, width, class."""

    endings: ClassVar[tuple[str, ...]] = (".csv",)
    form: ClassVar[Literal["csv", "parquet"]] = "csv"


class Parquet(_Table):
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

    def read(self, file: Path) -> list[TrafficTrack]:
        return tracks(I80_FILE, "parquet", {key: key for key in QUANTITIES}, I80_FACTORS)
