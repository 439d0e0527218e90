"""Estimates of the recorded run (the run whose estimates are kept): at a given time, and at the largest errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from trackbench.metrics.conditions import FIRST
from trackbench.metrics.intervals import ROUNDING
from trackbench.results import Result

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

#: Time between two moments of one object above which they are different peaks, s.
APART = 1.0
STATE = ["px_m", "py_m", "vx_mps", "vy_mps"]


@dataclass(frozen=True)
class EstimateMoment:
    """Estimate of one object by one tracker at one time, with its errors; an unknown error is None."""

    tracker: str
    object: str
    time_s: float
    px_m: float
    py_m: float
    vx_mps: float
    vy_mps: float
    position_error_m: float | None
    velocity_error_mps: float | None
    nees: float | None
    starting: bool
    """Whether the track is starting: the object has been known for less than a second."""


def recorded_estimates(result: Result) -> pd.DataFrame:
    """Return the estimates of the recorded run as a table, with a column ``starting``; the table can be empty.

    ``starting`` is True where the object has been known for less than a second.
    """
    frame = table_frame(result.tables.estimates, "due", *EstimateMoment.__dataclass_fields__)
    of_track, due = [frame["tracker"], frame["object"]], frame["due"] > 0
    begins = due & ~due.groupby(of_track).shift(fill_value=False)
    since = frame["time_s"].where(begins).groupby(of_track).ffill()
    start_s = max(0.0, FIRST - result.summary.score.settle_s)
    return frame.assign(starting=due & (frame["time_s"] - since < start_s * (1 - ROUNDING)))


def estimates_at(result: Result, time: float) -> list[EstimateMoment]:
    """Return the latest estimate of each tracker and object up to a time, s; missing estimates are left out."""
    return _moments(latest_rows(recorded_estimates(result), time, "tracker", "object").dropna(subset=STATE))


def worst(
    estimates: pd.DataFrame, trackers: Sequence[str], count: int, vehicle: str | None = None
) -> list[EstimateMoment]:
    """Return the scored moments with the largest position errors, the largest first and one for each peak of the error.

    Moments of a starting track come after all others, since every track starts with a large error.

    Args:
        estimates: table of :func:`recorded_estimates`.
        trackers: names of the trackers to look at; at each moment the largest error among these trackers counts.
        count: largest number of moments.
        vehicle: name of the only object to look at; None for all objects.
    """
    counted = estimates["tracker"].isin(trackers) & (estimates["due"] > 0)
    if vehicle is not None:
        counted &= estimates["object"] == vehicle
    rows = estimates[counted].dropna(subset="position_error_m")
    rows = rows.sort_values(["starting", "position_error_m"], ascending=[True, False], kind="stable")
    tops: list[Any] = []
    while len(tops) < count and len(rows):
        tops.append(rows.index[0])
        peak = rows.iloc[0]
        rows = rows[(rows["object"] != peak["object"]) | ((rows["time_s"] - peak["time_s"]).abs() > APART)]
    return _moments(estimates.loc[tops])


def table_frame(table: pa.Table, *required: str) -> pd.DataFrame:
    """Convert a table to a data frame with text for categories, and add the ``required`` columns that it lacks."""
    frame: pd.DataFrame = table.to_pandas(ignore_metadata=True)
    columns = dict.fromkeys([*frame.columns, *required])
    return frame.astype(dict.fromkeys(frame.select_dtypes("category").columns, object)).reindex(columns=list(columns))


def latest_rows(frame: pd.DataFrame, time: float, *keys: str) -> pd.DataFrame:
    """Return the last row up to a time, s, for each combination of values of the columns ``keys``."""
    return frame[frame["time_s"] <= time + 1e-9].groupby(list(keys), sort=False).tail(1)


def _moments(rows: pd.DataFrame) -> list[EstimateMoment]:
    values = rows[list(EstimateMoment.__dataclass_fields__)].astype(object)
    return [EstimateMoment(**row) for row in values.where(values.notna(), None).to_dict("records")]
