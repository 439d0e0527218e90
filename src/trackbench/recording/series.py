"""The scores over time: means over all runs with their bounds, and the recorded run by itself."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pyarrow as pa

from trackbench.metrics.consistency import mean_bounds, point95
from trackbench.palette import BOUND_COLOUR
from trackbench.recording.shapes import send_line
from trackbench.recording.stream import Stream, path
from trackbench.recording.tables import Columns, mean_over_objects, split
from trackbench.types import COMMON_STATE, Array

ALL_RUNS = "all_runs"
RECORDED_RUN = "recorded_run"
#: Rerun 0.41 has no logarithmic axis, so the errors are also there as decimal logarithms.
LOG = ("series", "log10")

#: What the line means under which the NIS of a consistent tracker is 95 % of the time.
SINGLE = "95 % of single innovations"

#: Lines that differ by less than this share are one line.
SAME = 1e-6


def send_all_runs(stream: Stream, steps: pa.Table, nis: pa.Table, colours: Mapping[str, str], reference: str) -> None:
    """RMSE with that of the reference, which has the given name; mean NEES and mean NIS with their 95 % bounds."""
    by_tracker = {tracker: rows for (tracker,), rows in split(steps, "tracker").items()}
    for quantity, unit in (("position", "m"), ("velocity", "mps")):
        place = ("series", ALL_RUNS, f"{quantity}_rmse")
        _lines(stream, place, by_tracker, f"{quantity}_rmse_{unit}", colours)
        _bounds(stream, place, reference, by_tracker, (f"{quantity}_reference_{unit}",), colours)
        columns = (f"{quantity}_rmse_{unit}", f"{quantity}_reference_{unit}")
        logs = {tracker: _log10(rows, columns) for tracker, rows in by_tracker.items()}
        log_place = (*LOG, *place[1:])
        _lines(stream, log_place, logs, columns[0], colours)
        _bounds(stream, log_place, reference, logs, columns[1:], colours)
    place = ("series", ALL_RUNS, "nees")
    _lines(stream, place, by_tracker, "nees_mean", colours)
    _bounds(stream, place, "95 % bounds", by_tracker, ("nees_low", "nees_high"), colours)
    for sensor, rows_by_tracker in _by_sensor(nis).items():
        nis_place = ("series", ALL_RUNS, "nis", sensor)
        _lines(stream, nis_place, rows_by_tracker, "nis_mean", colours)
        if _single(rows_by_tracker):
            lined = {tracker: _with_line(rows, int(rows["dof"][0])) for tracker, rows in rows_by_tracker.items()}
            _bounds(stream, nis_place, SINGLE, lined, ("line",), colours)
        else:
            _bounds(stream, nis_place, "95 % bounds", rows_by_tracker, ("nis_low", "nis_high"), colours)


def send_recorded_run(
    stream: Stream, estimates: pa.Table, recorded_nis: pa.Table, nis: pa.Table, colours: Mapping[str, str]
) -> None:
    """The recorded run's RMS position error over the targets, and its NEES and NIS averaged over the targets."""
    # A tracker may take less of a measurement than its sensor gives, so the degrees of freedom are its own.
    dof = {key: int(rows["dof"][0]) for key, rows in split(nis, "tracker", "sensor").items()}
    by_tracker = {tracker: rows for (tracker,), rows in split(estimates, "tracker").items()}
    error, nees = {}, {}
    for tracker, rows in by_tracker.items():
        time, square, _ = mean_over_objects(rows["time_s"], rows["position_error_m"] ** 2)
        error[tracker] = {"time_s": time, "value": np.sqrt(square)}
        nees[tracker] = _mean_with_bounds(rows["time_s"], rows["nees"], len(COMMON_STATE))
    _lines(stream, ("series", RECORDED_RUN, "position_error"), error, "value", colours)
    logs = {tracker: _log10(rows, ("value",)) for tracker, rows in error.items()}
    _lines(stream, (*LOG, RECORDED_RUN, "position_error"), logs, "value", colours)
    _with_bounds(stream, ("series", RECORDED_RUN, "nees"), nees, colours)
    for sensor, rows_by_tracker in _by_sensor(recorded_nis).items():
        means = {
            tracker: _mean_with_bounds(rows["time_s"], rows["nis"], dof[tracker, sensor])
            for tracker, rows in rows_by_tracker.items()
            if (tracker, sensor) in dof
        }
        nis_place = ("series", RECORDED_RUN, "nis", sensor)
        if _single(means):
            lined = {tracker: _with_line(rows, dof[tracker, sensor]) for tracker, rows in means.items()}
            _lines(stream, nis_place, lined, "value", colours)
            _bounds(stream, nis_place, SINGLE, lined, ("line",), colours)
        else:
            _with_bounds(stream, nis_place, means, colours)


def _log10(rows: Columns, names: tuple[str, ...]) -> Columns:
    """Logarithms of some columns, NaN where there is none."""
    return {**rows, **{name: np.log10(np.where(rows[name] > 0, rows[name], np.nan)) for name in names}}


def _by_sensor(table: pa.Table) -> dict[str, dict[str, Columns]]:
    grouped: dict[str, dict[str, Columns]] = {}
    for (sensor, tracker), rows in split(table, "sensor", "tracker").items():
        grouped.setdefault(sensor, {})[tracker] = rows
    return grouped


def _mean_with_bounds(time: Array, values: Array, dof: int) -> Columns:
    instants, mean, count = mean_over_objects(time, values)
    low, high = mean_bounds(dof, count)
    return {"time_s": instants, "value": mean, "low": low, "high": high, "count": count}


def _single(rows: dict[str, Columns]) -> bool:
    """Whether each value is a single innovation, and not a mean."""
    return bool(rows) and max(float(np.nanmax(columns["count"])) for columns in rows.values()) <= 1


def _with_line(rows: Columns, dof: int) -> Columns:
    return {**rows, "line": np.full(len(rows["time_s"]), point95(dof))}


def _with_bounds(stream: Stream, place: tuple[str, ...], rows: dict[str, Columns], colours: Mapping[str, str]) -> None:
    _lines(stream, place, rows, "value", colours)
    _bounds(stream, place, "95 % bounds", rows, ("low", "high"), colours)


def _lines(
    stream: Stream, place: tuple[str, ...], rows: dict[str, Columns], value: str, colours: Mapping[str, str]
) -> None:
    for tracker, colour in colours.items():
        if tracker in rows:
            send_line(stream, path(*place, tracker), rows[tracker]["time_s"], rows[tracker][value], tracker, colour)


def _bounds(
    stream: Stream,
    place: tuple[str, ...],
    name: str,
    rows: dict[str, Columns],
    fields: tuple[str, ...],
    colours: Mapping[str, str],
) -> None:
    """One line for all trackers that share it, in its tracker's colour where only some do and it is of one."""
    for field in fields:
        shared: list[list[str]] = []
        for tracker, tracker_rows in rows.items():
            if np.isfinite(tracker_rows[field]).any():
                group = next((group for group in shared if _same(rows[group[0]], tracker_rows, field)), None)
                if group is None:
                    shared.append([tracker])
                else:
                    group.append(tracker)
        for i, group in enumerate(shared, start=1):
            longest = max((rows[tracker] for tracker in group), key=lambda each: np.isfinite(each[field]).sum())
            alone = len(shared) > 1 and len(group) == 1
            colour = colours[group[0]] if alone else BOUND_COLOUR
            label = name if len(shared) == 1 else f"{name}: {', '.join(group)}"
            entity = path(*place, "bounds", f"{field}_{i}")
            send_line(stream, entity, longest["time_s"], longest[field], label, colour, width=2.0)


def _same(a: Columns, b: Columns, field: str) -> bool:
    """Whether it is the same at nearly all instants that both have: tracks may start a measurement apart."""
    _, at_a, at_b = np.intersect1d(a["time_s"], b["time_s"], return_indices=True)
    first, second = a[field][at_a], b[field][at_b]
    both = np.isfinite(first) & np.isfinite(second)
    return bool(both.any() and np.isclose(first[both], second[both], rtol=SAME).mean() > 0.9)
