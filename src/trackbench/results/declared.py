"""The tables of a result and the columns of each: the name, and what a column is made from."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from trackbench.base.types import Array
from trackbench.results.columns import DeclaredTable, Record, Source, mean


def _entries(*names: str) -> dict[str, Source]:
    """Columns that are the entries of their name."""
    return {name: name for name in names}


def _entry(name: str, *index: int) -> Callable[[Record], Any]:
    return lambda record: record[name][index]


def _mean(name: str, number: str = "count") -> Callable[[Record], Array]:
    return lambda record: mean(record[name], record[number])


def _root_mean(*squares: str) -> Callable[[Record], Array]:
    """Root of the mean of sums of squares over what was counted."""

    def compute(record: Record) -> Array:
        count = record["count"]
        return np.sqrt(mean(sum((record[name] for name in squares), np.zeros_like(count)), count))

    return compute


def _root_reference(name: str) -> Callable[[Record], Array]:
    """NaN where there is no reference."""
    return lambda record: np.sqrt(mean(np.where(record[name] > 0, record[name], np.nan), record["count"]))


def _error(first: int, second: int) -> Callable[[Record], Array]:
    return lambda record: np.hypot(record["error"][first], record["error"][second])


ERRORS: dict[str, Source] = {
    "position_rmse_m": _root_mean("px", "py"),
    "velocity_rmse_mps": _root_mean("vx", "vy"),
    **{f"{name}_rmse_m": _root_mean(name) for name in ("px", "py")},
    **{f"{name}_rmse_mps": _root_mean(name) for name in ("vx", "vy")},
}
REFERENCES: dict[str, Source] = {
    "position_reference_m": _root_reference("position_reference"),
    "velocity_reference_mps": _root_reference("velocity_reference"),
}
STATE: dict[str, Source] = {
    **{name: _entry("mean", row) for row, name in enumerate(("px_m", "py_m", "vx_mps", "vy_mps"))},
    **{f"p_{a}{b}": _entry("covariance", a, b) for a in range(4) for b in range(a, 4)},
}
MEASUREMENT: dict[str, Source] = {
    **{f"z{row}": _entry("measurement", row) for row in range(3)},
    **{name: _entry("position", row) for row, name in enumerate(("x_m", "y_m"))},
    **{f"sensor_{name}": _entry("sensor_pose", row) for row, name in enumerate(("x_m", "y_m", "yaw_rad"))},
}
NEES: dict[str, Source] = {"nees_mean": _mean("nees", "given")}
GOSPA_PARTS = ("gospa", "gospa_localisation", "gospa_missed", "gospa_false")
DECIDED = ("tracker", "function", "object")
#: Left where the scenario has functions: what each decides on each tracker's tracks and on the truth, and when a
#: function should have been active or should not have been (an outcome is answered, missed or false).
FUNCTION_TABLES = {
    "decisions": DeclaredTable(
        (*DECIDED, "true_object"),
        _entries("time_s", "active", "true_active", "impact", "quantity", "true_quantity"),
    ),
    "function_events": DeclaredTable((*DECIDED, "outcome"), _entries("run", "time_s", "until_s", "delay_s")),
}
SHARED = {
    **FUNCTION_TABLES,
    "truth": DeclaredTable(
        ("object", "role"),
        {
            **_entries("time_s", "alive"),
            **{f"{name}_m": name for name in ("px", "py")},
            **{f"{name}_rad": name for name in ("heading", "course")},
            **{f"{name}_mps": name for name in ("speed", "vx", "vy")},
            "acceleration_mps2": "acceleration",
            "yaw_rate_radps": "yaw_rate",
            **{f"{name}_m": name for name in ("length", "width")},
        },
    ),
    "roads": DeclaredTable((), _entries("line", "x_m", "y_m")),
    "differences": DeclaredTable(
        ("a", "b", "metric", "unit", "better", "verdict"),
        _entries("value", "ci95_low", "ci95_high", "margin", "p_value", "without_charged"),
    ),
}
#: The tables where identities are known.
LABELLED = {
    **SHARED,
    "steps": DeclaredTable(
        ("tracker",),
        _entries("time_s", "count", "given") | ERRORS | NEES | _entries("nees_low", "nees_high") | REFERENCES,
    ),
    "nis": DeclaredTable(
        ("tracker", "sensor"),
        {
            **_entries("time_s", "count"),
            "nis_mean": _mean("nis"),
            **_entries("nis_low", "nis_high", "dof"),
            "inside95": _mean("inside"),
        },
    ),
    "runs": DeclaredTable(
        ("tracker",),
        {
            **_entries("run", "scene", "count", "due", "given"),
            **ERRORS,
            **NEES,
            "nis_mean": lambda record: mean(record["nis"], record["nis_count"]),
            **REFERENCES,
            **_entries("diverged", "repaired"),
        },
    ),
    "stretches": DeclaredTable(("tracker",), _entries("run", "stretch", "count", "given") | ERRORS | NEES | REFERENCES),
    "measurements": DeclaredTable(
        ("sensor", "kind", "object"), _entries("time_s", "arrival_time_s", "valid") | MEASUREMENT
    ),
    "estimates": DeclaredTable(
        ("tracker", "object"),
        {
            **_entries("time_s"),
            **STATE,
            "position_error_m": _error(0, 1),
            "velocity_error_mps": _error(2, 3),
            **_entries("nees", "due"),
        },
    ),
    "recorded_nis": DeclaredTable(("tracker", "sensor", "object"), _entries("time_s", "nis")),
    "modes": DeclaredTable(("tracker", "mode"), _entries("time_s", "probability")),
    "recorded_modes": DeclaredTable(("tracker", "mode", "object"), _entries("time_s", "probability")),
}
#: The tables where identities are hidden.
HIDDEN = {
    **SHARED,
    "steps": DeclaredTable(
        ("tracker",), {**_entries("time_s"), **{f"{part}_m": _root_mean(part) for part in GOSPA_PARTS}}
    ),
    "runs": DeclaredTable(("tracker",), _entries("run", "scene", "count")),
    "measurements": DeclaredTable(
        ("sensor", "kind", "object"),
        _entries("scan", "detection", "time_s", "valid") | MEASUREMENT | _entries("own_track"),
    ),
    "tracks": DeclaredTable(("tracker",), _entries("time_s", "track") | STATE | _entries("existence")),
    "taken": DeclaredTable(("tracker",), _entries("time_s", "scan", "track", "detection")),
    "gates": DeclaredTable(("tracker",), _entries("time_s", "scan", "track", "x_m", "y_m")),
    "events": DeclaredTable(
        ("tracker", "kind", "object", "other_object", "why"),
        _entries("run", "time_s", "track", "other_track", "x_m", "y_m", "cost_m2"),
    ),
    "objects": DeclaredTable(("tracker", "object", "state"), _entries("time_s", "until_s")),
    "due": DeclaredTable(("object",), _entries("time_s", "status")),
}


def _of_other_scenes(table: DeclaredTable) -> DeclaredTable:
    """Return a table with the columns of another, for the scenes that are not recorded."""
    return table._replace(numbers=table.numbers | _entries("scene"))


#: Tables of the recorded scene alone.
OF_RECORDED_RUN = ("measurements", "estimates", "recorded_nis", "recorded_modes", "taken", "gates", "objects", "due")
LABELLED |= {"other_truth": _of_other_scenes(SHARED["truth"])}
HIDDEN |= {f"other_{name}": _of_other_scenes(HIDDEN[name]) for name in ("truth", "tracks")}
