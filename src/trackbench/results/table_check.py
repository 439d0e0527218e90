"""Whether stored tables are those of a run: their columns, the names in them, and rows at the same times."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from trackbench.base.errors import InputError, nearest
from trackbench.results.columns import split

STATE = ("px_m", "py_m", "vx_mps", "vy_mps")
ERRORS = (
    "position_rmse_m", "velocity_rmse_mps", "course_rmse_deg", "px_rmse_m", "py_rmse_m", "vx_rmse_mps", "vy_rmse_mps",
)  # fmt: skip
MOTION = ("heading_rad", "course_rad", "speed_mps", "acceleration_mps2", "yaw_rate_radps")
REFERENCE = ("position_reference_m", "velocity_reference_mps")
COVARIANCE = tuple(f"p_{a}{b}" for a in range(4) for b in range(a, 4))
#: Of each table the columns with names, which tell its series apart, and those with numbers.
COLUMNS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "steps": (
        ("tracker",),
        (
            "time_s",
            "count",
            *ERRORS,
            "position_p10_m",
            "position_p90_m",
            "nees_mean",
            "nees_low",
            "nees_high",
            *REFERENCE,
        ),
    ),
    "nis": (("tracker", "sensor"), ("time_s", "count", "nis_mean", "nis_low", "nis_high", "dof", "inside95")),
    "runs": (
        ("tracker",),
        (
            "run",
            "scene",
            "count",
            "course_count",
            "due",
            *ERRORS,
            "nees_mean",
            "nis_mean",
            *REFERENCE,
            "diverged",
            "repaired",
        ),
    ),
    "breakdown": (
        ("tracker", "manoeuvre"),
        ("range_from_m", "range_to_m", "count", "position_rmse_m", "velocity_rmse_mps", "nees_mean"),
    ),
    "autocorrelation": (("tracker", "sensor"), ("lag", "pairs", "correlation", "low", "high")),
    "truth": (("role", "object"), ("time_s", "alive", *STATE, *MOTION, "length_m", "width_m")),
    "measurements": (
        ("sensor", "kind", "object"),
        ("time_s", "valid", "z0", "z1", "x_m", "y_m", "sensor_x_m", "sensor_y_m", "sensor_yaw_rad"),
    ),
    "estimates": (
        ("tracker", "object"),
        ("time_s", *STATE, *COVARIANCE, "position_error_m", "velocity_error_mps", "nees", "due"),
    ),
    "recorded_nis": (("tracker", "sensor", "object"), ("time_s", "nis")),
    "modes": (("tracker", "mode"), ("time_s", "probability")),
    "recorded_modes": (("tracker", "mode", "object"), ("time_s", "probability")),
    "roads": ((), ("line", "x_m", "y_m")),
}
#: The same where identities are hidden.
HIDDEN_COLUMNS = {
    "steps": (("tracker",), ("time_s", "gospa_m", "gospa_localisation_m", "gospa_missed_m", "gospa_false_m")),
    "runs": (("tracker",), ("run", "scene", "count")),
    "truth": COLUMNS["truth"],
    "measurements": (COLUMNS["measurements"][0], ("scan", "detection", *COLUMNS["measurements"][1])),
    "tracks": (("tracker",), ("time_s", "track", *STATE, *COVARIANCE, "existence")),
    "taken": (("tracker",), ("time_s", "scan", "track", "detection")),
    "gates": (("tracker",), ("time_s", "scan", "track", "x_m", "y_m")),
    "due": (("object",), ("time_s", "status")),
    "events": (
        ("tracker", "kind", "object", "other_object", "why"),
        ("run", "time_s", "track", "other_track", "x_m", "y_m", "cost_m2"),
    ),
    "objects": (("tracker", "object", "state"), ("time_s", "until_s")),
    "association": (("tracker",), ("right", "wrong_object", "clutter", "missed")),
    "existence": (("tracker",), ("from", "to", "count", "stated", "real")),
    "roads": COLUMNS["roads"],
}
#: Of these, the ones in which all series have the same times.
HIDDEN_SERIES = ("steps", "truth", "due")
#: In the place of an object's name, where a detection stems from none, and where there is none.
FALSE_ALARM, NO_OBJECT = "false alarm", ""
#: Columns of counts and of what holds or not; all other numbers are floats.
WHOLE = ("due", "alive", "valid")
OBSERVER = "observer"
Names = Mapping[str, Collection[str]]


class TableLayout(NamedTuple):
    """What the tables of a run hold."""

    names: Names
    """What the columns of names may hold, by column."""
    objects: Sequence[str] = ()
    """Of the recorded run."""
    hidden: bool = False
    """Whether identities are hidden."""


def require_table(name: str, table: pa.Table, layout: TableLayout, file: Path) -> None:
    """Make sure that a table is one of a run.

    Args:
        name: of the table; one that is not known may hold anything.
        table: what was read.
        layout: of the run's tables.
        file: for error messages.

    Raises:
        InputError: it is not.
    """
    # What no tracker left has no columns either.
    known = HIDDEN_COLUMNS if layout.hidden else COLUMNS
    if name not in known or not (len(table) or table.num_columns):
        return
    names = layout.names
    texts, numbers = known[name]
    for column in (*texts, *numbers):
        if table.column_names.count(column) != 1:
            raise InputError(f"no column {column}, or several: not the table {name} of a run", file=file)
    for field in table.schema:
        kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        if not (pa.types.is_string(kind) if field.name in texts else _is_number(field.name, kind)):
            raise InputError(f"{field.name} is a column of {kind}: not the table {name} of a run", file=file)
    for column in texts:
        for value in pc.unique(table[column]).to_pylist():
            if value is None or value not in names.get(column, (value,)):
                hint = nearest(str(value), names.get(column, ()))
                raise InputError(f"{column} {value!r} is none of this run; {hint}", file=file)
    if "time_s" in numbers and (not layout.hidden or name in HIDDEN_SERIES):
        _require_times(name, table, texts, file)
    if name == "runs":
        _require_runs(table, file)
    if name == "truth":
        _require_objects(table, layout.objects, file)


def _require_runs(table: pa.Table, file: Path) -> None:
    """Each tracker has each run once."""
    for tracker in pc.unique(table["tracker"]).to_pylist():
        runs = table.filter(pc.equal(table["tracker"], tracker))["run"].to_numpy()
        if not np.array_equal(np.sort(runs), np.arange(len(runs))):
            raise InputError(f"{tracker} has not each run once: not the table runs of a run", file=file)


def _require_objects(table: pa.Table, objects: Sequence[str], file: Path) -> None:
    """The truth has each object of the run and what carries the sensors."""
    there = set(split(table, "role", "object"))
    for key in [*(("target", name) for name in objects), (OBSERVER, OBSERVER)]:
        if key not in there:
            raise InputError(f"{key[1]} is missing: not the table truth of this run", file=file)


def _require_times(name: str, table: pa.Table, texts: tuple[str, ...], file: Path) -> None:
    """The series of one sensor have the same times, each once; so have all series of what is of no sensor."""
    if table["time_s"].null_count or not np.isfinite(table["time_s"].to_numpy()).all():
        raise InputError(f"time_s is not finite: not the table {name} of a run", file=file)
    known: dict[str, np.ndarray] = {}
    for key, rows in split(table, *texts).items():
        sensor = key[texts.index("sensor")] if "sensor" in texts else ""
        times = known.setdefault(sensor, rows["time_s"])
        if not np.array_equal(times, rows["time_s"]) or not (np.diff(times) > 0).all():
            message = f"{' '.join(key)} has not each time of the others once: not the table {name} of a run"
            raise InputError(message, file=file)


def _is_number(name: str, kind: pa.DataType) -> bool:
    if name in WHOLE:
        return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind))
    # What has no value in any row has no type either.
    return bool(pa.types.is_floating(kind) or (name in ("range_from_m", "range_to_m") and pa.types.is_null(kind)))
