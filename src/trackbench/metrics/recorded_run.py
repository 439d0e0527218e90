"""The estimates of the recorded run out of its tables: those at a time, and when each tracker was worst."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from trackbench.base.errors import InputError, nearest_choices
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


def require_time(first: float, last: float, time: float) -> None:
    """Make sure that a time is one of a recording's.

    Raises:
        InputError: it is not.
    """
    # The last instant may not be a round number.
    if not first - 1e-9 <= time <= last + 1e-9:
        raise InputError(f"{time:g} s is not in the recording, which goes from {first:g} s to {last:g} s", key="--at")


def require_name(name: str, known: Iterable[str], what: str) -> str:
    """Return a name if it is one of those known.

    Args:
        name: of a vehicle or tracker.
        known: those in the recording.
        what: "vehicle" or "tracker"; also the option that gives it.

    Raises:
        InputError: it is not.
    """
    names = list(known)
    if name not in names:
        raise InputError(f"no {what} {name!r} in this recording; {nearest_choices(name, names)}", key=f"--{what}")
    return name


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
    """Return a moment for each row, with None where a number is not known."""
    values = rows[list(EstimateMoment.__dataclass_fields__)].astype(object)
    return [EstimateMoment(**row) for row in values.where(values.notna(), None).to_dict("records")]
