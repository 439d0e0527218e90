"""The tables of a result and the columns of each: the name, the unit and what a column is made from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from trackbench.base.config.key_units import UNITS
from trackbench.base.types import Array
from trackbench.results.columns import DeclaredTable, Record, TableColumn, mean


def _number(name: str, source: str | Callable[[Record], Any] = "", *, unit: str | None = None) -> TableColumn:
    """The unit is that in which the name ends, and the source the entry of this name, unless given."""
    ending = name.rpartition("_")[2]
    if unit is None:
        unit = UNITS[ending].symbol if ending in UNITS else "1"
    return TableColumn(name, unit, source or name)


def _numbers(*numbers: str | TableColumn) -> list[TableColumn]:
    """A number of which nothing but the name is said is the entry of this name."""
    return [_number(number) if isinstance(number, str) else number for number in numbers]


def _table(meaning: str, names: Sequence[str], numbers: Sequence[str | TableColumn]) -> DeclaredTable:
    """The names come first."""
    named = [TableColumn(name, "", name, is_name=True) for name in names]
    return DeclaredTable(meaning, [*named, *_numbers(*numbers)])


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


ERRORS = [
    _number("position_rmse_m", _root_mean("px", "py")),
    _number("velocity_rmse_mps", _root_mean("vx", "vy")),
    *(_number(f"{name}_rmse_m", _root_mean(name)) for name in ("px", "py")),
    *(_number(f"{name}_rmse_mps", _root_mean(name)) for name in ("vx", "vy")),
]
REFERENCES = [
    _number("position_reference_m", _root_reference("position_reference")),
    _number("velocity_reference_mps", _root_reference("velocity_reference")),
]
STATE = [
    *(_number(name, _entry("mean", row)) for row, name in enumerate(("px_m", "py_m", "vx_mps", "vy_mps"))),
    *(
        _number(f"p_{a}{b}", _entry("covariance", a, b), unit=("m^2", "m^2/s", "m^2/s^2")[(a > 1) + (b > 1)])
        for a in range(4)
        for b in range(a, 4)
    ),
]
MEASUREMENT = [
    *(_number(f"z{row}", _entry("measurement", row), unit="") for row in range(3)),
    *(_number(name, _entry("position", row)) for row, name in enumerate(("x_m", "y_m"))),
    *(_number(f"sensor_{name}", _entry("sensor_pose", row)) for row, name in enumerate(("x_m", "y_m", "yaw_rad"))),
]
GOSPA_PARTS = ("gospa", "gospa_localisation", "gospa_missed", "gospa_false")
VALID = _number("valid")
DUE = _number("due")
DECIDED = ("tracker", "function", "object")
#: Left where the scenario has functions.
FUNCTION_TABLES = {
    "decisions": _table(
        "what each function decides in the recorded run at each instant, on each tracker's tracks and on the truth",
        [*DECIDED, "true_object"],
        [
            "time_s",
            *(_number(name) for name in ("active", "true_active", "impact")),
            *(_number(name, unit="") for name in ("quantity", "true_quantity")),
        ],
    ),
    "function_events": _table(
        "when a function should have been active or should not have been: all of the recorded run, and the worst of "
        "the others; an outcome is answered, missed or false",
        [*DECIDED, "outcome"],
        ["run", "time_s", "until_s", _number("delay_s")],
    ),
}
SHARED = {
    **FUNCTION_TABLES,
    "truth": _table(
        "motion of every target and of the observer in the recorded run",
        ["object", "role"],
        [
            "time_s",
            _number("alive"),
            *(_number(f"{name}_m", name) for name in ("px", "py")),
            *(_number(f"{name}_rad", name) for name in ("heading", "course")),
            *(_number(f"{name}_mps", name) for name in ("speed", "vx", "vy")),
            _number("acceleration_mps2", "acceleration"),
            _number("yaw_rate_radps", "yaw_rate"),
            *(_number(f"{name}_m", name) for name in ("length", "width")),
        ],
    ),
    "roads": _table("lane edges to draw", [], ["line", "x_m", "y_m"]),
    "differences": _table(
        "value of one ranked tracker minus that of another; what is not tested has no verdict",
        ["a", "b", "metric", "unit", "better", "verdict"],
        [
            _number("value", unit=""),
            *(_number(name, unit="") for name in ("ci95_low", "ci95_high")),
            _number("margin", unit=""),
            *(_number(name) for name in ("p_value", "without_charged")),
        ],
    ),
}
#: The tables where identities are known.
LABELLED = {
    **SHARED,
    "steps": _table(
        "errors of each tracker at each instant, over runs and objects",
        ["tracker"],
        [
            *_numbers("time_s", "count", "given", *ERRORS),
            *_numbers(_number("nees_mean", _mean("nees", "given")), "nees_low", "nees_high", *REFERENCES),
        ],
    ),
    "nis": _table(
        "normalised innovation squared of each tracker and sensor at each measurement",
        ["tracker", "sensor"],
        [
            *_numbers("time_s", "count", _number("nis_mean", _mean("nis")), "nis_low", "nis_high"),
            *_numbers("dof", _number("inside95", _mean("inside"))),
        ],
    ),
    "runs": _table(
        "errors of each tracker in each run",
        ["tracker"],
        [
            *_numbers("run", "scene", "count", DUE, "given", *ERRORS),
            _number("nees_mean", _mean("nees", "given")),
            _number("nis_mean", lambda record: mean(record["nis"], record["nis_count"])),
            *_numbers(*REFERENCES, "diverged", "repaired"),
        ],
    ),
    "stretches": _table(
        "of a single run or few logs: errors of each tracker in each stretch of time, which stand for independent runs",
        ["tracker"],
        [
            *_numbers("run", "stretch", "count", "given", *ERRORS),
            *_numbers(_number("nees_mean", _mean("nees", "given")), *REFERENCES),
        ],
    ),
    "measurements": _table(
        "every measurement of the recorded run, with the position in the fixed frame that it states",
        ["sensor", "kind", "object"],
        [*_numbers("time_s", "arrival_time_s"), VALID, *MEASUREMENT],
    ),
    "estimates": _table(
        "every tracker's estimates of the recorded run",
        ["tracker", "object"],
        [
            *_numbers(
                "time_s", *STATE, _number("position_error_m", _error(0, 1)), _number("velocity_error_mps", _error(2, 3))
            ),
            *_numbers("nees", DUE),
        ],
    ),
    "recorded_nis": _table(
        "normalised innovation squared of every measurement of the recorded run",
        ["tracker", "sensor", "object"],
        ["time_s", "nis"],
    ),
    "modes": _table(
        "if trackers have modes: their probability at each instant, mean over runs and objects",
        ["tracker", "mode"],
        ["time_s", "probability"],
    ),
    "recorded_modes": _table(
        "if trackers have modes: their probability in the recorded run",
        ["tracker", "mode", "object"],
        ["time_s", "probability"],
    ),
}
#: The tables where identities are hidden.
HIDDEN = {
    **SHARED,
    "steps": _table(
        "root mean square over runs of each tracker's GOSPA and its parts at each instant",
        ["tracker"],
        ["time_s", *(_number(f"{part}_m", _root_mean(part)) for part in GOSPA_PARTS)],
    ),
    "runs": _table(
        "total and count of each metric of each tracker in each run", ["tracker"], ["run", "scene", "count"]
    ),
    "measurements": _table(
        "every detection of the recorded run, with what caused it; without a truth, the sensor's own track",
        ["sensor", "kind", "object"],
        ["scan", "detection", "time_s", VALID, *MEASUREMENT, "own_track"],
    ),
    "tracks": _table(
        "every confirmed track of the recorded run at each instant",
        ["tracker"],
        ["time_s", "track", *STATE, "existence"],
    ),
    "taken": _table(
        "the detection that each track of the recorded run took in each scan",
        ["tracker"],
        ["time_s", "scan", "track", "detection"],
    ),
    "gates": _table(
        "outlines of the gates of built-in trackers in the recorded run",
        ["tracker"],
        ["time_s", "scan", "track", "x_m", "y_m"],
    ),
    "events": _table(
        "what happened to objects and tracks: all of the recorded run, and the dearest of the others",
        ["tracker", "kind", "object", "other_object", "why"],
        ["run", "time_s", "track", "other_track", "x_m", "y_m", _number("cost_m2", unit="m^2")],
    ),
    "objects": _table(
        "what each object's time was spent on in the recorded run, stretch by stretch",
        ["tracker", "object", "state"],
        ["time_s", "until_s"],
    ),
    "due": _table(
        "0 absent, 1 optional, 2 due, of each object at each instant of the recorded run",
        ["object"],
        ["time_s", "status"],
    ),
}


def _of_other_scenes(table: DeclaredTable) -> DeclaredTable:
    """Return a table with the columns of another, for the scenes that are not recorded."""
    return DeclaredTable(f"{table.meaning}, for the other scenes", [*table.columns, _number("scene")])


#: Tables of the recorded scene alone.
OF_RECORDED_RUN = ("measurements", "estimates", "recorded_nis", "recorded_modes", "taken", "gates", "objects", "due")
LABELLED |= {"other_truth": _of_other_scenes(SHARED["truth"])}
HIDDEN |= {f"other_{name}": _of_other_scenes(HIDDEN[name]) for name in ("truth", "tracks")}
