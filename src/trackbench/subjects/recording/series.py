"""The charts of a recording: means over all runs with their bounds, the recorded run, and each of its vehicles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from trackbench.base.types import COMMON_STATE, Array
from trackbench.document.palette import BOUND_COLOUR, mode_colours
from trackbench.document.replay import Chart, ChartLine
from trackbench.metrics.consistency import mean_bounds
from trackbench.results.columns import Columns, mean_over_objects, split
from trackbench.subjects.recording.contents import Contents

ALL_RUNS = "all_runs"
RECORDED_RUN = "recorded_run"
VEHICLES = "vehicles"
MODES = "modes"

#: Title of each chart with hidden identities, by column.
PARTS = {
    "gospa_m": "GOSPA",
    "gospa_localisation_m": "Localisation part",
    "gospa_missed_m": "Missed part",
    "gospa_false_m": "False part",
}

BOUNDS = "95 % bounds"

#: Width of a single run's lines, which are less smooth than means, pixels.
SINGLE_WIDTH = 1.0
#: Relative difference below which bounds of two trackers are one line.
SAME = 1e-6

#: Name, unit and column suffix of each kind of error.
QUANTITIES = (("Position", "m", "m"), ("Velocity", "m/s", "mps"))
NOTHING = pa.table({})
#: Longest time without a value that a line bridges, s.
GAP_S = 1.0
#: Rows of each tracker, by name.
ByTracker = dict[str, Columns]


class Charts(NamedTuple):
    """Charts of errors, NEES, NIS and mode probabilities for one choice of runs and vehicles."""

    errors: tuple[Chart, ...]
    """Errors of position and velocity."""
    nees: Chart
    nis: tuple[Chart, ...]
    """One NIS chart for each sensor; none where no tracker gives innovations."""
    modes: tuple[Chart, ...] = ()
    """Mode probabilities, one chart for each tracker with several motion models."""

    @property
    def all(self) -> tuple[Chart, ...]:
        return (*self.errors, self.nees, *self.nis, *self.modes)


class AllCharts(NamedTuple):
    """Charts of a recording: means over all runs, the recorded run, and each of its vehicles."""

    all_runs: Charts
    recorded: Charts
    vehicles: dict[str, Charts]


def charts_of(contents: Contents) -> AllCharts:
    """Return charts of errors, NEES, NIS and modes: over all runs, of the recorded run, and of each vehicle.

    Baseline trackers have no lines in them.
    """
    tables, colours = contents.tables, contents.plotted
    parts = (tables.estimates, tables.recorded_nis, tables.if_there("recorded_modes"))
    vehicles = {}
    for name in contents.vehicles:
        estimates, nis, modes = (_of_object(table, name) for table in parts)
        vehicles[name] = recorded_run(estimates, nis, modes, tables.nis, colours, name)
    return AllCharts(_all_runs(contents), recorded_run(*parts, tables.nis, colours), vehicles)


def _all_runs(contents: Contents) -> Charts:
    """Return the charts over all runs: RMSE with the reference's, and mean NEES and NIS with their 95 % bounds."""
    tables, reference = contents.tables, contents.result.summary.reference
    label = "" if reference is None else reference.label
    charts = _charts((ALL_RUNS,), "RMSE", _by_tracker(tables.steps), _by_sensor(tables.nis), contents.plotted, label)
    return charts._replace(modes=_mode_charts((ALL_RUNS,), tables.if_there("modes"), contents.plotted))


def recorded_run(
    estimates: pa.Table,
    recorded_nis: pa.Table,
    modes: pa.Table,
    nis: pa.Table,
    colours: Mapping[str, str],
    vehicle: str | None = None,
) -> Charts:
    """Return the recorded run's charts of errors, NEES and NIS, over all vehicles or for ``vehicle`` alone.

    ``estimates``, ``recorded_nis`` and ``modes`` are rows of these vehicles. ``nis`` has each tracker's degrees of
    freedom: a tracker may use fewer components of a measurement than its sensor gives.
    """
    entity = (RECORDED_RUN,) if vehicle is None else (VEHICLES, vehicle)
    steps = {tracker: _recorded_steps(rows) for tracker, rows in _by_tracker(estimates).items()}
    dof = {key: int(rows["dof"][0]) for key, rows in split(nis, "sensor", "tracker").items()}
    sensors = {
        sensor: {
            tracker: _mean_with_bounds(rows, "nis", dof[sensor, tracker])
            for tracker, rows in by_tracker.items()
            if (sensor, tracker) in dof
        }
        for sensor, by_tracker in _by_sensor(recorded_nis).items()
    }
    charts = _charts(entity, "error", steps, sensors, colours, width=SINGLE_WIDTH)
    return charts._replace(modes=_mode_charts(entity, modes, colours))


def _recorded_steps(rows: Columns) -> Columns:
    """Return the means over the recorded run's vehicles, with the columns of table ``steps``."""
    errors = {
        f"{quantity.lower()}_rmse_{suffix}": np.sqrt(
            mean_over_objects(rows["time_s"], rows[f"{quantity.lower()}_error_{suffix}"] ** 2)[1]
        )
        for quantity, _, suffix in QUANTITIES
    }
    return {**_mean_with_bounds(rows, "nees", len(COMMON_STATE)), **errors}


def _charts(
    place: tuple[str, ...],
    kind: str,
    steps: ByTracker,
    nis: Mapping[str, ByTracker],
    colours: Mapping[str, str],
    reference: str = "",
    width: float = 1.5,
) -> Charts:
    """Return the charts of rows that have the columns of tables ``steps`` and ``nis``."""
    errors = tuple(
        Chart(
            (*place, f"{quantity.lower()}_{kind.lower()}"),
            f"{quantity} {kind}",
            unit,
            _lines(steps, f"{quantity.lower()}_rmse_{suffix}", colours, width),
            _bounds(reference, steps, (f"{quantity.lower()}_reference_{suffix}",), colours),
        )
        for quantity, unit, suffix in QUANTITIES
    )
    bounds = _bounds(BOUNDS, steps, ("nees_low", "nees_high"), colours)
    nees = Chart((*place, "nees"), "NEES", "", _lines(steps, "nees_mean", colours, width), bounds)
    sensors = []
    for sensor, rows in nis.items():
        bounds = _bounds(BOUNDS, rows, ("nis_low", "nis_high"), colours)
        lines = _lines(rows, "nis_mean", colours)
        sensors.append(Chart((*place, "nis", sensor), f"NIS {sensor}", "", lines, bounds))
    return Charts(errors, nees, tuple(sensors))


def _of_object(table: pa.Table, name: str) -> pa.Table:
    return table.filter(pc.equal(table["object"], name)) if table.num_rows else table


def _by_tracker(table: pa.Table) -> ByTracker:
    return {tracker: rows for (tracker,), rows in split(table, "tracker").items()}


def _by_sensor(table: pa.Table) -> dict[str, ByTracker]:
    grouped: dict[str, ByTracker] = {}
    for (sensor, tracker), rows in split(table, "sensor", "tracker").items():
        grouped.setdefault(sensor, {})[tracker] = rows
    return grouped


def _mean_with_bounds(rows: Columns, name: str, dof: int) -> Columns:
    instants, mean, count = mean_over_objects(rows["time_s"], rows[name])
    low, high = mean_bounds(dof, count)
    return {"time_s": instants, f"{name}_mean": mean, f"{name}_low": low, f"{name}_high": high}


def _lines(
    rows: ByTracker, value: str, colours: Mapping[str, str], width: float = 1.5, gap: float = GAP_S
) -> tuple[ChartLine, ...]:
    return tuple(
        ChartLine((tracker,), tracker, colour, *_with_gaps(rows[tracker], value, gap), width)
        for tracker, colour in colours.items()
        if tracker in rows
    )


def _with_gaps(rows: Columns, value: str, gap: float = GAP_S) -> tuple[Array, Array]:
    """Return times and values, with NaN inserted where no value follows within ``gap`` s, which breaks the line."""
    time, values = rows["time_s"], rows[value]
    before = np.flatnonzero(np.diff(time) > gap)
    return np.insert(time, before + 1, time[before] + gap), np.insert(values, before + 1, np.nan)


def _bounds(name: str, rows: ByTracker, fields: tuple[str, ...], colours: Mapping[str, str]) -> tuple[ChartLine, ...]:
    """Return the lines of bounds: grey where trackers share a bound, otherwise in the tracker's colour."""
    lines = []
    for field in fields:
        shown = {tracker: bound for tracker, bound in rows.items() if tracker in colours and field in bound}
        groups: dict[str, list[str]] = {}
        for tracker, bound in shown.items():
            if np.isfinite(bound[field]).any():
                first = next((first for first in groups if _agree(shown[first], bound, field)), tracker)
                groups.setdefault(first, []).append(tracker)
        for first, group in groups.items():
            colour = BOUND_COLOUR if len(group) > 1 or len(groups) == 1 else colours[first]
            label = name if len(groups) == 1 else f"{name}: {', '.join(group)}"
            lines.append(ChartLine(("bounds", field, first), label, colour, *_with_gaps(shown[first], field), 2.0))
    return tuple(lines)


def _agree(a: Columns, b: Columns, field: str) -> bool:
    """Return whether two bounds agree at nearly all common instants; tracks can start a measurement apart."""
    _, at_a, at_b = np.intersect1d(a["time_s"], b["time_s"], return_indices=True)
    first, second = a[field][at_a], b[field][at_b]
    both = np.isfinite(first) & np.isfinite(second)
    return bool(both.any() and np.isclose(first[both], second[both], rtol=SAME).mean() > 0.9)


def _mode_charts(place: tuple[str, ...], modes: pa.Table, trackers: Iterable[str]) -> tuple[Chart, ...]:
    """Return a chart for each tracker with modes, with each mode's mean probability over the vehicles."""
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
    """Return the charts of GOSPA and its parts over all runs."""
    steps = _by_tracker(contents.tables.steps)
    return [
        Chart((ALL_RUNS, name), title, "m", _lines(steps, name, contents.colours, gap=np.inf))
        for name, title in PARTS.items()
    ]
