"""The estimates of the recorded run out of its tables: those at a time, and when each tracker was worst."""

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

#: Two moments of one object are told apart if they lie farther apart than this, s.
APART = 1.0
STATE = ["px_m", "py_m", "vx_mps", "vy_mps"]


@dataclass(frozen=True)
class EstimateMoment:
    """A tracker's estimate of an object, and its errors; None where they are not known."""

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
    """Whether the track starts: the object is known for less than a second."""


def recorded_estimates(result: Result) -> pd.DataFrame:
    """Return the table of estimates, with a column ``starting``; without rows where there are none."""
    frame = table_frame(result.tables.estimates, "due", *EstimateMoment.__dataclass_fields__)
    of_track, due = [frame["tracker"], frame["object"]], frame["due"] > 0
    begins = due & ~due.groupby(of_track).shift(fill_value=False)
    since = frame["time_s"].where(begins).groupby(of_track).ffill()
    start_s = max(0.0, FIRST - result.summary.score.settle_s)
    return frame.assign(starting=due & (frame["time_s"] - since < start_s * (1 - ROUNDING)))


def estimates_at(result: Result, time: float) -> list[EstimateMoment]:
    """Return the latest estimate of each tracker and object up to a time, of those that there are."""
    return _moments(latest_rows(recorded_estimates(result), time, "tracker", "object").dropna(subset=STATE))


def worst(
    estimates: pd.DataFrame, trackers: Sequence[str], count: int, vehicle: str | None = None
) -> list[EstimateMoment]:
    """Return the scored moments of the largest position error, the largest first; of one peak only its top.

    Moments at which the track starts come after all others: every track starts with a large error.

    Args:
        estimates: of :func:`recorded_estimates`.
        trackers: whose errors are looked at; at each moment the largest of them counts.
        count: how many moments at most.
        vehicle: of this one alone.
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
    """Return a table as a data frame, whose names are text, with columns that it has none of where it has no rows."""
    frame: pd.DataFrame = table.to_pandas(ignore_metadata=True)
    columns = dict.fromkeys([*frame.columns, *required])
    return frame.astype(dict.fromkeys(frame.select_dtypes("category").columns, object)).reindex(columns=list(columns))


def latest_rows(frame: pd.DataFrame, time: float, *keys: str) -> pd.DataFrame:
    """Return the last row of each series up to a time, s, but for rounding."""
    return frame[frame["time_s"] <= time + 1e-9].groupby(list(keys), sort=False).tail(1)


def _moments(rows: pd.DataFrame) -> list[EstimateMoment]:
    values = rows[list(EstimateMoment.__dataclass_fields__)].astype(object)
    return [EstimateMoment(**row) for row in values.where(values.notna(), None).to_dict("records")]
