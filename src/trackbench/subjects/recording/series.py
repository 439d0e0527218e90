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
from trackbench.metrics.function_events import drawn_instants
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

#: What the errors are of, with the unit and what it is called in the name of a column.
QUANTITIES = (("Position", "m", "m"), ("Velocity", "m/s", "mps"))
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
    """All charts of a recording."""

    all_runs: Charts
    recorded: Charts
    vehicles: dict[str, Charts]


def charts_of(contents: Contents) -> AllCharts:
    """Return every chart of a recording, without baselines."""
    tables, colours = contents.tables, contents.plotted
    recorded_modes = tables.if_there("recorded_modes")
    recorded = recorded_run(tables.estimates, tables.recorded_nis, recorded_modes, tables.nis, colours)
    estimates, nis, modes = map(_by_object, (tables.estimates, tables.recorded_nis, recorded_modes))
    vehicles = {}
    for name in contents.vehicles:
        estimate, own_nis, own_modes = (of.get(name, NOTHING) for of in (estimates, nis, modes))
        vehicles[name] = recorded_run(estimate, own_nis, own_modes, tables.nis, colours, name)
    return AllCharts(_all_runs(contents), recorded, vehicles)


def _all_runs(contents: Contents) -> Charts:
    """Return RMSE with that of the reference, and mean NEES and NIS with their 95 % bounds."""
    tables, colours = contents.tables, contents.plotted
    reference = contents.result.summary.reference
    label = "" if reference is None else reference.label
    rows = _by_tracker(tables.steps)
    errors = tuple(
        Chart(
            (ALL_RUNS, f"{quantity.lower()}_rmse"),
            f"{quantity} RMSE",
            unit,
            _lines(rows, f"{quantity.lower()}_rmse_{suffix}", colours),
            _bounds(label, rows, (f"{quantity.lower()}_reference_{suffix}",), colours),
        )
        for quantity, unit, suffix in QUANTITIES
    )
    bounds = _bounds(BOUNDS, rows, ("nees_low", "nees_high"), colours)
    nees = Chart((ALL_RUNS, "nees"), "NEES", "", _lines(rows, "nees_mean", colours), bounds)
    dof = _degrees_of_freedom(tables.nis)
    sensors = tuple(
        _nis((ALL_RUNS,), sensor, of_sensor, ("nis_mean", "nis_low", "nis_high"), dof, colours)
        for sensor, of_sensor in _by_sensor(tables.nis).items()
    )
    return Charts(errors, nees, sensors, _mode_charts((ALL_RUNS,), tables.if_there("modes"), colours))


def recorded_run(
    estimates: pa.Table,
    recorded_nis: pa.Table,
    modes: pa.Table,
    nis: pa.Table,
    colours: Mapping[str, str],
    vehicle: str | None = None,
) -> Charts:
    """Return the recorded run's errors, NEES and NIS: root mean squares and means over its vehicles, or of one.

    ``estimates``, ``recorded_nis`` and ``modes`` are of these vehicles, ``nis`` is over all runs: a tracker may take
    less of a measurement than its sensor gives, so the degrees of freedom are its own.
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
        for quantity, unit, suffix in QUANTITIES
    )
    dof = _degrees_of_freedom(nis)
    means = {name: _mean_with_bounds(of, "nees", len(COMMON_STATE)) for name, of in rows.items()}
    bounds = _bounds(BOUNDS, means, ("low", "high"), colours)
    nees = Chart((*place, "nees"), "NEES", "", _lines(means, "value", colours, SINGLE_WIDTH), bounds)
    sensors = []
    for sensor, by_tracker in _by_sensor(recorded_nis).items():
        own = {name: of for name, of in by_tracker.items() if (name, sensor) in dof}
        of_sensor = {name: _mean_with_bounds(of, "nis", dof[name, sensor]) for name, of in own.items()}
        sensors.append(_nis(place, sensor, of_sensor, ("value", "low", "high"), dof, colours))
    return Charts(errors, nees, tuple(sensors), _mode_charts(place, modes, colours))


def _nis(
    place: tuple[str, ...],
    sensor: str,
    rows: ByTracker,
    columns: tuple[str, str, str],
    dof: Mapping[tuple[str, ...], int],
    colours: Mapping[str, str],
) -> Chart:
    """Return the NIS with bounds of its mean, or with the line of single innovations where none is a mean."""
    value, *limits = columns
    if rows and max(float(np.nanmax(of["count"], initial=0.0)) for of in rows.values()) <= 1:
        lined: ByTracker = {
            name: {**of, "line": np.full(len(of["time_s"]), point95(dof[name, sensor]))} for name, of in rows.items()
        }
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


def _lines(
    rows: ByTracker, value: str, colours: Mapping[str, str], width: float = 1.5, gap: float = GAP_S
) -> tuple[ChartLine, ...]:
    return tuple(
        ChartLine((tracker,), tracker, colour, *_broken(rows[tracker], value, gap), width)
        for tracker, colour in colours.items()
        if tracker in rows
    )


def _broken(rows: Columns, value: str, gap: float = GAP_S) -> tuple[Array, Array]:
    """Return times and values, with a missing value where none follows within ``gap`` s."""
    time, values = rows["time_s"], rows[value]
    before = np.flatnonzero(np.diff(time) > gap)
    return np.insert(time, before + 1, time[before] + gap), np.insert(values, before + 1, np.nan)


def _bounds(name: str, rows: ByTracker, fields: tuple[str, ...], colours: Mapping[str, str]) -> tuple[ChartLine, ...]:
    """Return one line for all trackers that share a bound, in the colour of a tracker that has its own."""
    lines = []
    for field in fields:
        shared: list[list[str]] = []
        for tracker, tracker_rows in rows.items():
            if tracker in colours and np.isfinite(tracker_rows[field]).any():
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
            lines.append(ChartLine(("bounds", f"{field}_{i}"), label, colour, *_broken(longest, field), 2.0))
    return tuple(lines)


def _same(a: Columns, b: Columns, field: str) -> bool:
    """Return whether two bounds agree at nearly all common instants: tracks may start a measurement apart."""
    _, at_a, at_b = np.intersect1d(a["time_s"], b["time_s"], return_indices=True)
    first, second = a[field][at_a], b[field][at_b]
    both = np.isfinite(first) & np.isfinite(second)
    return bool(both.any() and np.isclose(first[both], second[both], rtol=SAME).mean() > 0.9)


def _mode_charts(place: tuple[str, ...], modes: pa.Table, trackers: Iterable[str]) -> tuple[Chart, ...]:
    """Return a chart for each tracker that has modes, with a line for each mode: the mean over vehicles."""
    by_mode = split(modes, "tracker", "mode")
    colours = mode_colours(mode for _, mode in by_mode)
    lines: dict[str, list[ChartLine]] = {}
    for (tracker, mode), rows in by_mode.items():
        time, mean, _ = mean_over_objects(rows["time_s"], rows["probability"])
        lines.setdefault(tracker, []).append(ChartLine((mode,), mode, colours[mode], time, mean))
    return tuple(
        Chart((*place, MODES, tracker), f"Modes of {tracker}", "", tuple(lines[tracker]), share=True)
        for tracker in trackers
        if tracker in lines
    )


def charts_of_tracks(contents: Contents) -> list[Chart]:
    """Return GOSPA and its parts over all runs, and the numbers of tracks and due objects in the recorded run."""
    tables, colours = contents.tables, contents.colours
    steps = _by_tracker(tables.steps)
    parts = [
        Chart((ALL_RUNS, name), title, "m", _lines(steps, name, colours, gap=np.inf)) for name, title in PARTS.items()
    ]
    time = drawn_instants(tables)
    tracks = {tracker: rows["time_s"] for tracker, rows in _by_tracker(tables.tracks).items()}
    lines = tuple(
        ChartLine((tracker,), tracker, colour, time, _count(tracks.get(tracker, np.empty(0)), time))
        for tracker, colour in colours.items()
    )
    due = tables.due
    when = due["time_s"].to_numpy()[due["status"].to_numpy() == DUE] if due.num_rows else np.empty(0)
    bound = ChartLine(("due",), "due objects", BOUND_COLOUR, time, _count(when, time), 2.0)
    return [*parts, Chart((RECORDED_RUN, "tracks"), "Tracks, and objects due", "", lines, (bound,))]


def _count(when: Array, time: Array) -> Array:
    return np.bincount(np.searchsorted(time, when - 1e-9), minlength=len(time)).astype(float)
