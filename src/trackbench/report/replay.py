"""Scene of the recorded run (the run kept for drawing), which a page plays: vehicles, measurements, tracks, events."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from trackbench.base.types import Array
from trackbench.document import TrackerStyle
from trackbench.document.palette import OBSERVER_COLOUR, TRUTH_COLOUR, sensor_colours
from trackbench.document.replay import (
    Chart,
    ChartLine,
    ReplayEvent,
    ReplayMeasurements,
    ReplayPath,
    ReplayScene,
    ReplayStart,
    extent_of,
)
from trackbench.metrics.function_events import events_of
from trackbench.metrics.recorded_run import EstimateMoment
from trackbench.report.figures.map import MARKS
from trackbench.report.moments import moment_text
from trackbench.results import Result
from trackbench.results.columns import Columns, split, table_columns
from trackbench.results.folder import FALSE_ALARM

#: Shortest side of a drawn vehicle or fixed observer, m.
_SHORTEST_M = 1.0


def replay_of_run(
    result: Result, styles: Sequence[TrackerStyle], chosen: Sequence[str], moments: Mapping[str, EstimateMoment]
) -> ReplayScene | None:
    """Return the recorded run as a scene that opens at the time of the largest error; None without a true path.

    Args:
        result: the run.
        styles: styles of the trackers that a reader can choose to display.
        chosen: names of the trackers displayed at first, best first.
        moments: time and object of each tracker's largest error, by tracker; empty with hidden identities.
    """
    hidden = result.summary.identities == "hidden"
    vehicles = {path.name: path for path in _vehicles(result)}
    if not vehicles:
        return None
    errors = _gospa_of_run(result, styles) if hidden else _largest_errors(result, styles)
    quantity = "GOSPA of this run" if hidden else "Largest position error of any vehicle"
    lines = tuple(ChartLine((style.key,), style.name, style.colour, *errors[style.name]) for style in styles)
    if hidden:
        events = [
            ReplayEvent(event.tracker, event.kind, event.time_s, event.x_m, event.y_m, f"{event.kind}, {event.reason}")
            for event in events_of(result, run=result.summary.recorded_run)
            if event.kind in MARKS and event.tracker in errors
        ]
        worst = next((event for event in events if event.tracker == chosen[0]), None)
        start = _start_at_event(worst, vehicles) if worst else _start_at_largest(*errors[chosen[0]])
    else:
        events = _worst_events({name: moments[name] for name in errors if name in moments}, vehicles)
        worst = next((event for event in events if event.tracker in chosen), None)
        start = _start_at_event(worst, vehicles) if worst else None
    return ReplayScene(
        "run",
        (*vehicles.values(), *_tracks(result, styles)),
        tuple(_measurements(result)),
        *extent_of(vehicles.values()),
        beside=(Chart(("error",), quantity, "m", lines),),
        lanes=tuple(_lanes(result)),
        trackers=tuple(styles),
        shown=tuple(chosen),
        events=tuple(events),
        start=start,
    )


def _vehicles(result: Result) -> Iterator[ReplayPath]:
    for (name, role), rows in split(result.tables.truth, "object", "role").items():
        rows = {column: values[rows["alive"].astype(bool)] for column, values in rows.items()}
        if len(rows["time_s"]):
            yield ReplayPath(
                name,
                OBSERVER_COLOUR if role == "observer" else TRUTH_COLOUR,
                rows["time_s"],
                _position(rows),
                heading=np.unwrap(rows["heading_rad"]),
                size=(max(float(rows["length_m"][0]), _SHORTEST_M), max(float(rows["width_m"][0]), _SHORTEST_M)),
                is_observer=role == "observer",
            )


def _lanes(result: Result) -> Iterator[Array]:
    if result.tables.roads.num_rows:
        line, x, y = table_columns(result.tables.roads).values()
        yield from (np.stack([x, y])[:, line == number] for number in np.unique(line))


def _tracks(result: Result, styles: Sequence[TrackerStyle]) -> Iterator[ReplayPath]:
    """Yield the estimates of each object or, with hidden identities, the tracks labelled by their numbers."""
    colours = {style.name: style.colour for style in styles}
    hidden = result.summary.identities == "hidden"
    table, key = (result.tables.tracks, "track") if hidden else (result.tables.estimates, "object")
    for (tracker, identity), rows in split(table, "tracker", key).items():
        finite = np.isfinite(_position(rows)).all(axis=0)
        if tracker in colours and finite.any():
            p = np.array([[rows["p_00"], rows["p_01"]], [rows["p_01"], rows["p_11"]]])[:, :, finite]
            label = f"{float(identity):g}" if hidden else ""
            time, position = rows["time_s"][finite], _position(rows)[:, finite]
            yield ReplayPath(identity, colours[tracker], time, position, p, tracker=tracker, label=label)


def _position(rows: Columns) -> Array:
    return np.stack([rows["px_m"], rows["py_m"]])


def _measurements(result: Result) -> Iterator[ReplayMeasurements]:
    """Yield the measured positions of each sensor, with covariances by the noise that the sensor states."""
    colours = sensor_colours(result.summary.sensors)
    for (sensor,), rows in split(result.tables.measurements, "sensor").items():
        has_position = rows["valid"].astype(bool) & np.isfinite(rows["x_m"])
        rows = {name: values[has_position] for name, values in rows.items()}
        position = np.stack([rows["x_m"], rows["y_m"]])
        from_sensor = position - [rows["sensor_x_m"], rows["sensor_y_m"]]
        sigmas = result.summary.sensors[sensor].sigmas
        along, across, angle = (sigmas.get(name, 0.0) for name in ("x_m", "y_m", "azimuth_deg"))
        yaw = rows["sensor_yaw_rad"]
        if "range_m" in sigmas:
            yaw = np.arctan2(from_sensor[1], from_sensor[0])
            along, across = sigmas["range_m"], np.deg2rad(angle) * np.hypot(*from_sensor)
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        spread = np.array([np.full(len(yaw), along), np.broadcast_to(across, len(yaw))]) ** 2
        covariance = np.einsum("ikn,kn,jkn->ijn", turn, spread, turn)
        is_false = np.asarray(rows["object"] == FALSE_ALARM)
        yield ReplayMeasurements(sensor, colours[sensor], rows["time_s"], position, covariance, is_false)


#: Times, s, and values.
Series = tuple[Array, Array]


def _largest_errors(result: Result, styles: Sequence[TrackerStyle]) -> dict[str, Series]:
    """Return, by tracker, the largest position error of any due object at each instant, m."""
    rows_of = split(result.tables.estimates, "tracker")
    errors: dict[str, Series] = {}
    for style in styles:
        rows = rows_of[style.name,]
        time, first = np.unique(rows["time_s"], return_index=True)
        due = np.where(rows["due"] > 0, rows["position_error_m"], np.nan)
        errors[style.name] = time, np.fmax.reduceat(due, first)
    return errors


def _gospa_of_run(result: Result, styles: Sequence[TrackerStyle]) -> dict[str, Series]:
    """Return, by tracker, GOSPA at each instant of the recorded run, m; NaN in older results without GOSPA."""
    rows_of = split(result.tables.steps, "tracker")
    values = {style.name: rows_of[style.name,] for style in styles}
    nothing = np.full(max((len(rows["time_s"]) for rows in values.values()), default=0), np.nan)
    return {name: (rows["time_s"], rows.get("recorded_gospa_m", nothing)) for name, rows in values.items()}


def _worst_events(moments: Mapping[str, EstimateMoment], vehicles: Mapping[str, ReplayPath]) -> list[ReplayEvent]:
    """Return each tracker's largest error as an event at the object's true position, the largest error first."""
    return [
        ReplayEvent(
            name,
            "worst",
            moment.time_s,
            *_position_at(vehicles[moment.object], moment.time_s),
            f"largest error {moment_text(moment)}",
        )
        for name, moment in sorted(moments.items(), key=lambda item: -(item[1].position_error_m or 0.0))
    ]


def _start_at_largest(time: Array, value: Array) -> ReplayStart | None:
    """Return the start of a replay at the time of the largest value, with the whole scene in view; None if all NaN."""
    return ReplayStart(float(time[np.nanargmax(value)]), "") if np.isfinite(value).any() else None


def _start_at_event(event: ReplayEvent, vehicles: Mapping[str, ReplayPath]) -> ReplayStart:
    """Return the start of a replay at the time of an event, with the vehicle nearest to the event in the middle."""
    distance_m = {
        name: float(np.hypot(*np.subtract(_position_at(path, event.time_s), event[3:5])))
        for name, path in vehicles.items()
        if path.time[0] <= event.time_s + 1e-9 <= path.time[-1] + 2e-9
    }
    return ReplayStart(event.time_s, min(distance_m, key=lambda name: distance_m[name], default=""))


def _position_at(path: ReplayPath, time_s: float) -> tuple[float, float]:
    x, y = (float(np.interp(time_s, path.time, values)) for values in path.position)
    return x, y
