"""The scores over time: means over all runs with their bounds, and the shown run by itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr

from trackbench.metrics.consistency import mean_bounds
from trackbench.palette import BOUND_COLOUR
from trackbench.recording.stream import Stream, path, rgba
from trackbench.recording.tables import Columns, mean_over_objects, split
from trackbench.types import COMMON_STATE, Array

ALL_RUNS = "all_runs"
SHOWN_RUN = "shown_run"

#: Lines that differ by less than this share are one line.
SAME = 1e-6


def send_all_runs(stream: Stream, steps: pa.Table, nis: pa.Table, colours: dict[str, str]) -> None:
    """RMSE with the Cramér-Rao bound, mean NEES and mean NIS with their 95 % bounds."""
    by_tracker = {tracker: rows for (tracker,), rows in split(steps, "tracker").items()}
    for quantity, unit in (("position", "m"), ("velocity", "mps")):
        place = ("series", ALL_RUNS, f"{quantity}_rmse")
        _lines(stream, place, by_tracker, f"{quantity}_rmse_{unit}", colours)
        _bounds(stream, place, "Cramér-Rao bound", by_tracker, (f"{quantity}_bound_{unit}",))
    place = ("series", ALL_RUNS, "nees")
    _lines(stream, place, by_tracker, "nees_mean", colours)
    _bounds(stream, place, "95 % bounds", by_tracker, ("nees_low", "nees_high"))
    for sensor, rows_by_tracker in _by_sensor(nis).items():
        place = ("series", ALL_RUNS, "nis", sensor)
        _lines(stream, place, rows_by_tracker, "nis_mean", colours)
        _bounds(stream, place, "95 % bounds", rows_by_tracker, ("nis_low", "nis_high"))


def send_shown_run(
    stream: Stream, estimates: pa.Table, shown_nis: pa.Table, dof: dict[str, int], colours: dict[str, str]
) -> None:
    """The shown run's RMS position error over the targets, and its NEES and NIS averaged over the targets.

    Args:
        dof: degrees of freedom of each sensor's readings.
    """
    by_tracker = {tracker: rows for (tracker,), rows in split(estimates, "tracker").items()}
    error, nees = {}, {}
    for tracker, rows in by_tracker.items():
        time, square, _ = mean_over_objects(rows["time_s"], rows["position_error_m"] ** 2)
        error[tracker] = {"time_s": time, "value": np.sqrt(square)}
        nees[tracker] = _mean_with_bounds(rows["time_s"], rows["nees"], len(COMMON_STATE))
    _lines(stream, ("series", SHOWN_RUN, "position_error"), error, "value", colours)
    _with_bounds(stream, ("series", SHOWN_RUN, "nees"), nees, colours)
    for sensor, rows_by_tracker in _by_sensor(shown_nis).items():
        nis = {
            tracker: _mean_with_bounds(rows["time_s"], rows["nis"], dof[sensor])
            for tracker, rows in rows_by_tracker.items()
        }
        _with_bounds(stream, ("series", SHOWN_RUN, "nis", sensor), nis, colours)


def _by_sensor(table: pa.Table) -> dict[str, dict[str, Columns]]:
    grouped: dict[str, dict[str, Columns]] = {}
    for (sensor, tracker), rows in split(table, "sensor", "tracker").items():
        grouped.setdefault(sensor, {})[tracker] = rows
    return grouped


def _mean_with_bounds(time: Array, values: Array, dof: int) -> Columns:
    instants, mean, count = mean_over_objects(time, values)
    low, high = mean_bounds(dof, count)
    return {"time_s": instants, "value": mean, "low": low, "high": high}


def _with_bounds(stream: Stream, place: tuple[str, ...], rows: dict[str, Columns], colours: dict[str, str]) -> None:
    _lines(stream, place, rows, "value", colours)
    _bounds(stream, place, "95 % bounds", rows, ("low", "high"))


def _lines(
    stream: Stream, place: tuple[str, ...], rows: dict[str, Columns], value: str, colours: dict[str, str]
) -> None:
    for tracker, colour in colours.items():
        if tracker in rows:
            _line(stream, path(*place, tracker), rows[tracker]["time_s"], rows[tracker][value], tracker, colour, 1.5)


def _bounds(
    stream: Stream, place: tuple[str, ...], name: str, rows: dict[str, Columns], fields: tuple[str, ...]
) -> None:
    """One line for each field where the trackers share it, as they do when they use the same readings."""
    for field in fields:
        drawn: list[tuple[Array, Array]] = []
        for tracker_rows in rows.values():
            time, values = tracker_rows["time_s"], tracker_rows[field]
            if np.isfinite(values).any() and not any(_same(time, values, *other) for other in drawn):
                drawn.append((time, values))
                entity = path(*place, "bounds", f"{field}_{len(drawn)}")
                _line(stream, entity, time, values, name, BOUND_COLOUR, 2.0)


def _same(time: Array, values: Array, other_time: Array, other_values: Array) -> bool:
    return np.array_equal(time, other_time) and np.allclose(values, other_values, rtol=SAME, equal_nan=True)


def _line(stream: Stream, entity: str, time: Array, values: Array, name: str, colour: str, width: float) -> None:
    finite = np.isfinite(values)
    # An empty row breaks the line where there is no value.
    stream.columns(entity, time, rr.Scalars.columns(scalars=values[finite]).partition(finite.astype(int)))
    style: dict[str, Any] = {"colors": rgba(colour), "widths": width, "names": name}
    stream.static(entity, rr.SeriesLines(**style))
