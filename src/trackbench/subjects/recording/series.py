"""The charts of a run: means over all runs with their bounds, the recorded run, and each vehicle of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from trackbench.base.types import COMMON_STATE, DUE, Array
from trackbench.document.palette import BOUND_COLOUR, mode_colours
from trackbench.document.replay import Chart, ChartLine
from trackbench.metrics.consistency import mean_bounds, point95
from trackbench.metrics.track_events import instants
from trackbench.results.columns import Columns, mean_over_objects, split
from trackbench.subjects.recording.contents import Contents

ALL_RUNS = "all_runs"
RECORDED_RUN = "recorded_run"
VEHICLES = "vehicles"
MODES = "modes"

#: Charts of hidden identities by column.
PARTS = {
    "gospa_m": "GOSPA",
    "gospa_localisation_m": "Localisation part",
    "gospa_missed_m": "Missed part",
    "gospa_false_m": "False part",
}

#: What the line means under which the NIS of a consistent tracker is 95 % of the time.
SINGLE = "95 % of single innovations"
BOUNDS = "95 % bounds"

#: Of the lines of a single run, which are less smooth than means, pixels.
SINGLE_WIDTH = 1.0
#: Lines that differ by less than this share are one line.
SAME = 1e-6

NOTHING = pa.table({})
#: Lines are broken where there is no value for longer than this, s.
GAP_S = 1.0
#: Rows of each tracker.
ByTracker = dict[str, Columns]


class Charts(NamedTuple):
    """The charts of the same runs and vehicles."""

    errors: tuple[Chart, ...]
    """Of position and of velocity."""
    nees: Chart
    nis: tuple[Chart, ...]
    """By sensor; none where no tracker gives innovations."""
    modes: tuple[Chart, ...] = ()
    """By tracker that has several motion models: the probability of each."""

    @property
    def all(self) -> tuple[Chart, ...]:
        return (*self.errors, self.nees, *self.nis, *self.modes)


class AllCharts(NamedTuple):
    """Every chart of a recording."""

    all_runs: Charts
    recorded: Charts
    vehicles: dict[str, Charts]


def charts_of(contents: Contents) -> AllCharts:
    """Every chart of a recording."""
    tables, colours = contents.tables, contents.colours
    estimates, nis = (_by_object(table) for table in (tables.estimates, tables.recorded_nis))
    recorded_modes = tables.if_there("recorded_modes")
    modes = _by_object(recorded_modes)
    runs = all_runs(tables.steps, tables.nis, colours, contents.reference)
    recorded = recorded_run(tables.estimates, tables.recorded_nis, tables.nis, colours)
    vehicles = {
        name: recorded_run(estimates.get(name, NOTHING), nis.get(name, NOTHING), tables.nis, colours, name)
        for name in contents.vehicles
    }
    return AllCharts(
        runs._replace(modes=mode_charts((ALL_RUNS,), tables.if_there("modes"), colours)),
        recorded._replace(modes=mode_charts((RECORDED_RUN,), recorded_modes, colours)),
        {
            name: of._replace(modes=mode_charts((VEHICLES, name), modes.get(name, NOTHING), colours))
            for name, of in vehicles.items()
        },
    )


def all_runs(steps: pa.Table, nis: pa.Table, colours: Mapping[str, str], reference: str) -> Charts:
    """RMSE with that of the reference, which has the given name, and mean NEES and NIS with their 95 % bounds."""
    rows = _by_tracker(steps)
    errors = tuple(
        Chart(
            (ALL_RUNS, f"{quantity.lower()}_rmse"),
            f"{quantity} RMSE",
            unit,
            _lines(rows, f"{quantity.lower()}_rmse_{suffix}", colours),
            _bounds(reference, rows, (f"{quantity.lower()}_reference_{suffix}",), colours),
        )
        for quantity, unit, suffix in (("Position", "m", "m"), ("Velocity", "m/s", "mps"))
    )
    bounds = _bounds(BOUNDS, rows, ("nees_low", "nees_high"), colours)
    nees = Chart((ALL_RUNS, "nees"), "NEES", "", _lines(rows, "nees_mean", colours), bounds)
    dof = _degrees_of_freedom(nis)
    sensors = tuple(
        _nis((ALL_RUNS,), sensor, rows, ("nis_mean", "nis_low", "nis_high"), dof, colours)
        for sensor, rows in _by_sensor(nis).items()
    )
    return Charts(errors, nees, sensors)


def recorded_run(
    estimates: pa.Table, recorded_nis: pa.Table, nis: pa.Table, colours: Mapping[str, str], vehicle: str | None = None
) -> Charts:
    """The recorded run's errors, NEES and NIS: root mean squares and means over its vehicles, or of one of them.

    Args:
        estimates: of these vehicles in the recorded run.
        recorded_nis: of these vehicles in the recorded run.
        nis: over all runs; a tracker may take less of a measurement than its sensor gives, so the degrees of freedom
            are its own.
        colours: by tracker.
        vehicle: the only one, if it is one.
    """
    place = (RECORDED_RUN,) if vehicle is None else (VEHICLES, vehicle)
    rows = _by_tracker(estimates)
    errors = tuple(
        Chart(
            (*place, f"{quantity.lower()}_error"),
            f"{quantity} error",
            unit,
            _lines(_rms(rows, f"{quantity.lower()}_error_{suffix}"), "value", colours, SINGLE_WIDTH),
        )
        for quantity, unit, suffix in (("Position", "m", "m"), ("Velocity", "m/s", "mps"))
    )
    dof = _degrees_of_freedom(nis)
    means = {name: _mean_with_bounds(of, "nees", len(COMMON_STATE)) for name, of in rows.items()}
    bounds = _bounds(BOUNDS, means, ("low", "high"), colours)
    nees = Chart((*place, "nees"), "NEES", "", _lines(means, "value", colours, SINGLE_WIDTH), bounds)
    sensors = tuple(
        _nis(
            place,
            sensor,
            {
                name: _mean_with_bounds(of, "nis", dof[name, sensor])
                for name, of in by_tracker.items()
                if (name, sensor) in dof
            },
            ("value", "low", "high"),
            dof,
            colours,
        )
        for sensor, by_tracker in _by_sensor(recorded_nis).items()
    )
    return Charts(errors, nees, sensors)


def _nis(
    place: tuple[str, ...],
    sensor: str,
    rows: ByTracker,
    columns: tuple[str, str, str],
    dof: Mapping[tuple[str, ...], int],
    colours: Mapping[str, str],
) -> Chart:
    """With the bounds of its mean, or the line of a single innovation where none is a mean of several."""
    value, *limits = columns
    if rows and max(float(np.nanmax(of["count"], initial=0.0)) for of in rows.values()) <= 1:
        lined = {name: _with_line(of, dof[name, sensor]) for name, of in rows.items()}
        bounds = _bounds(SINGLE, lined, ("line",), colours)
    else:
        bounds = _bounds(BOUNDS, rows, tuple(limits), colours)
    return Chart((*place, "nis", sensor), f"NIS {sensor}", "", _lines(rows, value, colours), bounds)


def _by_object(table: pa.Table) -> dict[str, pa.Table]:
    names = pc.unique(table["object"]).to_pylist() if table.num_rows else []
    return {name: table.filter(pc.equal(table["object"], name)) for name in names}


def _by_tracker(table: pa.Table) -> ByTracker:
    return {tracker: rows for (tracker,), rows in split(table, "tracker").items()}


def _by_sensor(table: pa.Table) -> dict[str, ByTracker]:
    grouped: dict[str, ByTracker] = {}
    for (sensor, tracker), rows in split(table, "sensor", "tracker").items():
        grouped.setdefault(sensor, {})[tracker] = rows
    return grouped


def _degrees_of_freedom(nis: pa.Table) -> dict[tuple[str, ...], int]:
    return {key: int(rows["dof"][0]) for key, rows in split(nis, "tracker", "sensor").items()}


def _rms(rows: ByTracker, name: str) -> ByTracker:
    means = {tracker: mean_over_objects(of["time_s"], of[name] ** 2) for tracker, of in rows.items()}
    return {tracker: {"time_s": time, "value": np.sqrt(square)} for tracker, (time, square, _) in means.items()}


def _mean_with_bounds(rows: Columns, name: str, dof: int) -> Columns:
    instants, mean, count = mean_over_objects(rows["time_s"], rows[name])
    low, high = mean_bounds(dof, count)
    return {"time_s": instants, "value": mean, "low": low, "high": high, "count": count}


def _with_line(rows: Columns, dof: int) -> Columns:
    return {**rows, "line": np.full(len(rows["time_s"]), point95(dof))}


def _lines(
    rows: ByTracker, value: str, colours: Mapping[str, str], width: float = 1.5, gap: float = GAP_S
) -> tuple[ChartLine, ...]:
    return tuple(
        ChartLine((tracker,), tracker, colour, *_broken(rows[tracker], value, gap), width)
        for tracker, colour in colours.items()
        if tracker in rows
    )


def _broken(rows: Columns, value: str, gap: float = GAP_S) -> tuple[Array, Array]:
    """Times and values, with a missing value where none follows within ``gap`` s."""
    time, values = rows["time_s"], rows[value]
    before = np.flatnonzero(np.diff(time) > gap)
    return np.insert(time, before + 1, time[before] + gap), np.insert(values, before + 1, np.nan)


def _bounds(name: str, rows: ByTracker, fields: tuple[str, ...], colours: Mapping[str, str]) -> tuple[ChartLine, ...]:
    """One line for all trackers that share it, in its tracker's colour where only some do and it is of one."""
    found = []
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
            found.append(ChartLine(("bounds", f"{field}_{i}"), label, colour, *_broken(longest, field), 2.0))
    return tuple(found)


def _same(a: Columns, b: Columns, field: str) -> bool:
    """Whether it is the same at nearly all instants that both have: tracks may start a measurement apart."""
    _, at_a, at_b = np.intersect1d(a["time_s"], b["time_s"], return_indices=True)
    first, second = a[field][at_a], b[field][at_b]
    both = np.isfinite(first) & np.isfinite(second)
    return bool(both.any() and np.isclose(first[both], second[both], rtol=SAME).mean() > 0.9)


def mode_charts(place: tuple[str, ...], modes: pa.Table, trackers: Iterable[str]) -> tuple[Chart, ...]:
    """A chart for each tracker that has modes, with a line for each: the mean over the vehicles of the table.

    Args:
        place: the entity of the charts, below that of all series.
        modes: over all runs or of the recorded one.
        trackers: those that are drawn.
    """
    of = split(modes, "tracker", "mode")
    colours = mode_colours(mode for _, mode in of)
    lines: dict[str, list[ChartLine]] = {}
    for (tracker, mode), rows in of.items():
        time, mean, _ = mean_over_objects(rows["time_s"], rows["probability"])
        lines.setdefault(tracker, []).append(ChartLine((mode,), mode, colours[mode], time, mean))
    return tuple(
        Chart((*place, MODES, tracker), f"Modes of {tracker}", "", tuple(lines[tracker]), share=True)
        for tracker in trackers
        if tracker in lines
    )


def charts_of_tracks(contents: Contents) -> list[Chart]:
    """GOSPA and its parts over all runs, and how many tracks and due objects there are in the recorded one."""
    steps = _by_tracker(contents.tables.steps)
    parts = [
        Chart((ALL_RUNS, name), title, "m", _lines(steps, name, contents.colours, gap=np.inf))
        for name, title in PARTS.items()
    ]
    return [*parts, _track_count(contents)]


def _track_count(contents: Contents) -> Chart:
    """How many confirmed tracks each tracker has, and how many objects are due."""
    time = instants(contents.tables)
    tracks = {tracker: rows["time_s"] for tracker, rows in _by_tracker(contents.tables.tracks).items()}
    lines = tuple(
        ChartLine((tracker,), tracker, colour, time, _count(tracks.get(tracker, np.empty(0)), time))
        for tracker, colour in contents.colours.items()
    )
    due = contents.tables.due
    when = due["time_s"].to_numpy()[due["status"].to_numpy() == DUE] if due.num_rows else np.empty(0)
    bound = ChartLine(("due",), "due objects", BOUND_COLOUR, time, _count(when, time), 2.0)
    return Chart((RECORDED_RUN, "tracks"), "Tracks, and objects due", "", lines, (bound,))


def _count(when: Array, time: Array) -> Array:
    return np.bincount(np.searchsorted(time, when - 1e-9), minlength=len(time)).astype(float)
