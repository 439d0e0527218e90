"""Tables of recorded traffic: CSV and Parquet of one's own, and I-80, which comes with the package."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from decimal import ROUND_FLOOR, Decimal
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from trackbench.base.config import Problem
from trackbench.base.errors import InputError, nearest
from trackbench.base.types import Array
from trackbench.truth import jumps
from trackbench.truth.config.columns import Units
from trackbench.truth.layouts import QUANTITIES, REQUIRED, ColumnLayout, header, layout
from trackbench.truth.recorded.rows import Rows, read_table, time_stamps
from trackbench.truth.track_rows import COVARIANCE, TrackRows
from trackbench.truth.tracks import RowsFormat

#: Times up to this count from 0 s, as a program's own clock does; larger ones from the first whole second.
FROM_ZERO_S = 1e7
#: What cannot be meant: the least, the most, and why.
_NO_SIZE = (np.nextafter(0, 1), np.inf, "which is no size; leave it empty where it is not known")
POSSIBLE = {"length": _NO_SIZE, "width": _NO_SIZE, "existence": (0.0, 1.0, "which is no probability")}


def table_rows(rows: Rows, found: ColumnLayout, factors: Mapping[str, float]) -> TrackRows:
    """The rows of a table of tracks.

    Args:
        rows: of the table.
        found: where it has what.
        factors: what the columns are multiplied by.

    Raises:
        InputError: a row is damaged.
    """

    def numbers(key: str) -> Array | None:
        if key not in found.columns:
            return None
        optional = key not in REQUIRED
        return rows.numbers(found.columns[key], factors[key], QUANTITIES[key], optional=optional)

    def texts(key: str) -> list[str] | None:
        if key not in found.columns:
            return None
        return ["" if value is None else str(value).strip() for value in rows.columns[found.columns[key]]]

    stamps = time_stamps(rows, found.columns["time"], factors["time"])
    start = min(stamps).to_integral_value(ROUND_FLOOR) if max(map(abs, stamps)) > FROM_ZERO_S else Decimal(0)
    time = np.array([float(stamp - start) for stamp in stamps])
    latest = int(np.argmax(time))
    if time[latest] - time.min() > jumps.LONGEST:
        problem = jumps.why_too_long(float(time[latest] - time.min()))
        raise rows.error(latest, f"{found.columns['time']}: {problem}, such as time={found.columns['time']}:ns")
    covariance = None
    if any(key in found.columns for key in COVARIANCE):
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
            raise rows.error(row, f"{found.columns[key]} is {values[row]:g}, {why}")
    named: dict[str, Any] = {key: texts(key) for key in ("scene", "run", "fingerprint")}
    return TrackRows(
        rows.names(found.columns["id"]),
        time,
        numeric.pop("x"),
        numeric.pop("y"),
        **numeric,
        covariance=covariance,
        kind=texts("class"),
        **named,
        start=start,
        notes=tuple(found.lines),
    )


class TableFormat(RowsFormat):
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

    def problems(self) -> Iterator[Problem]:
        for key in self.columns:
            if key not in QUANTITIES:
                yield Problem(("columns", key), f"no column of traffic; {nearest(key, QUANTITIES)}")

    def rows(self, file: Path) -> TrackRows:
        try:
            found = layout(header(file, self.form), self.columns)
        except InputError as error:
            raise error.located(file=file, line=None) from None
        factors = {key: found.factor(key, self.units.factor(quantity, None)) for key, quantity in QUANTITIES.items()}
        return table_rows(read_table(file, self.form, found.columns.values()), found, factors)


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


class InterstateI80(RowsFormat):
    """NGSIM I-80, which comes with the package: 200 vehicles, 10 s of each. No path is needed."""

    endings: ClassVar[tuple[str, ...]] = ()
    simultaneous: ClassVar[bool] = False

    def rows(self, file: Path) -> TrackRows:
        names = header(I80_FILE, "parquet")
        factors = {**dict.fromkeys(QUANTITIES, 1.0), **I80_FACTORS}
        return table_rows(
            read_table(I80_FILE, "parquet", names), ColumnLayout({name: name for name in names}, {}), factors
        )
