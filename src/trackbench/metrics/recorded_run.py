"""The recorded run out of its tables: what there is at a time, and when each tracker was worst."""

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


@dataclass(frozen=True)
class VehicleMoment:
    """The true motion of the observer or of a target."""

    name: str
    role: str
    px_m: float
    py_m: float
    vx_mps: float
    vy_mps: float
    speed_mps: float
    course_rad: float
    acceleration_mps2: float
    yaw_rate_radps: float


@dataclass(frozen=True)
class MeasurementMoment:
    """Where a sensor has seen an object."""

    sensor: str
    object: str
    time_s: float
    x_m: float
    y_m: float


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


@dataclass(frozen=True)
class SceneMoment:
    """Everything at a time."""

    time_s: float
    vehicles: list[VehicleMoment]
    measurements: list[MeasurementMoment]
    estimates: list[EstimateMoment]


def recorded_estimates(result: Result) -> pd.DataFrame:
    """Return the table of estimates, with a column ``starting``; without rows where there are none."""
    frame = _frame(result.tables.estimates, "due", *EstimateMoment.__dataclass_fields__)
    of_track, due = [frame["tracker"], frame["object"]], frame["due"] > 0
    begins = due & ~due.groupby(of_track).shift(fill_value=False)
    since = frame["time_s"].where(begins).groupby(of_track).ffill()
    start_s = max(0.0, FIRST - result.summary.score.settle_s)
    return frame.assign(starting=due & (frame["time_s"] - since < start_s * (1 - ROUNDING)))


def scene_at(result: Result, time: float) -> SceneMoment:
    """Return vehicles, measurements and estimates as a viewer shows them at a time: the latest of each up to then.

    Raises:
        InputError: the recording does not have that time.
    """
    truth = _frame(result.tables.truth)
    require_time(truth["time_s"].min(), truth["time_s"].max(), time)
    present = _latest(truth, time, "role", "object").query("alive > 0")
    measurements = _frame(result.tables.measurements, "valid", *MeasurementMoment.__dataclass_fields__)
    measured = _latest(measurements, time, "sensor", "object").query("valid > 0")
    estimates = _latest(recorded_estimates(result), time, "tracker", "object")
    estimates = estimates[estimates["object"].isin(present["object"])]
    return SceneMoment(
        time_s=float(truth["time_s"][truth["time_s"] <= time + 1e-9].max()),
        vehicles=_moments(VehicleMoment, present.rename(columns={"object": "name"})),
        measurements=_moments(MeasurementMoment, measured),
        estimates=_moments(EstimateMoment, estimates.dropna(subset=["px_m", "py_m", "vx_mps", "vy_mps"])),
    )


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
    return _moments(EstimateMoment, estimates.loc[tops])


def _frame(table: pa.Table, *required: str) -> pd.DataFrame:
    """Return a table as a data frame, whose names are text, with columns that it has none of where it has no rows."""
    frame: pd.DataFrame = table.to_pandas(ignore_metadata=True)
    columns = dict.fromkeys([*frame.columns, *required])
    return frame.astype(dict.fromkeys(frame.select_dtypes("category").columns, object)).reindex(columns=list(columns))


def _latest(frame: pd.DataFrame, time: float, *keys: str) -> pd.DataFrame:
    """Return the last row of each series up to a time, up to rounding."""
    return frame[frame["time_s"] <= time + 1e-9].groupby(list(keys), sort=False).tail(1)


def _moments(kind: type[Any], rows: pd.DataFrame) -> list[Any]:
    """Return an object of a class for each row, None where a number is not known."""
    values = rows[list(kind.__dataclass_fields__)].astype(object)
    return [kind(**row) for row in values.where(values.notna(), None).to_dict("records")]
