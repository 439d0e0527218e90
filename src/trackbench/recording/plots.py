"""How the scores are laid out: errors, NEES and NIS side by side, all runs above the recorded run."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb

from trackbench.metrics.consistency import mean_bounds
from trackbench.recording.contents import Contents
from trackbench.recording.series import ALL_RUNS, LOG, RECORDED_RUN
from trackbench.recording.stream import path
from trackbench.recording.tables import split
from trackbench.types import COMMON_STATE, Array

#: Time axes end later than the run by this share; with a legend there, it covers no line.
BESIDE, BESIDE_LEGEND = 1.04, 1.6


def plots(contents: Contents) -> rrb.Container:
    """A column each for the error, the NEES and, where any tracker gives innovations, the NIS."""
    tables, end = contents.tables, contents.duration_s
    steps, estimates = tables.steps, tables.estimates
    runs, recorded = f"{contents.runs} runs", f"run {contents.recorded_run}"
    rmse = []
    for name, place, unit, column in (
        ("Position", "position_rmse", "m", "position_rmse_m"),
        ("Velocity", "velocity_rmse", "m/s", "velocity_rmse_mps"),
    ):
        top = _top(_values(steps, column))
        rmse.append(_plot(f"{name} RMSE, {runs}, {unit}", (ALL_RUNS, place), end, top, legend=True))
        rmse.append(_log_plot(f"log10 of {name.lower()} RMSE, {runs}, {unit}", (ALL_RUNS, place), end))
    error_top = _top(_values(estimates, "position_error_m"))
    errors = [
        _plot(f"Position error, {recorded}, m", (RECORDED_RUN, "position_error"), end, error_top, legend=True),
        _log_plot(f"log10 of position error, {recorded}, m", (RECORDED_RUN, "position_error"), end),
    ]
    nees_top = _top(_values(steps, "nees_mean"), _values(steps, "nees_high"))
    nees = _plot(f"NEES and 95 % bounds, {runs}", (ALL_RUNS, "nees"), end, nees_top)
    recorded_top = _top(_values(estimates, "nees"), mean_bounds(len(COMMON_STATE), contents.targets)[1])
    recorded_nees = _plot(f"NEES and 95 % bounds, {recorded}", (RECORDED_RUN, "nees"), end, recorded_top)
    stacks = [
        rrb.Vertical(rrb.Tabs(*rmse, active_tab=0), rrb.Tabs(*errors, active_tab=0)),
        rrb.Vertical(nees, recorded_nees),
    ]

    sensors = []
    recorded_nis = split(tables.recorded_nis, "sensor")
    for (sensor,), rows in split(tables.nis, "sensor").items():
        top = _top(rows["nis_mean"], rows["nis_high"])
        pair = [_plot(f"NIS, {sensor}, {runs}", (ALL_RUNS, "nis", sensor), end, top)]
        if (sensor,) in recorded_nis:
            bound = mean_bounds(int(rows["dof"].max()), contents.targets)[1]
            recorded_top = _top(recorded_nis[sensor,]["nis"], bound)
            pair.append(_plot(f"NIS, {sensor}, {recorded}", (RECORDED_RUN, "nis", sensor), end, recorded_top))
        sensors.append(pair)
    # Two cells at most; further sensors are tabs of theirs.
    cells = [[plot for pair in sensors[i::2] for plot in pair] for i in range(min(2, len(sensors)))]
    if cells:
        stacks.append(rrb.Vertical(*(rrb.Tabs(*cell) for cell in cells)))
    return rrb.Horizontal(*stacks)


def live_plots() -> rrb.Container:
    """The error and the NEES of the recorded run as they come."""
    return rrb.Horizontal(
        rrb.TimeSeriesView(origin=path("series", RECORDED_RUN, "position_error"), name="Position error, m"),
        rrb.TimeSeriesView(origin=path("series", RECORDED_RUN, "nees"), name="NEES and 95 % bounds"),
    )


def _plot(name: str, place: tuple[str, ...], end: float, top: float, legend: bool = False) -> rrb.TimeSeriesView:
    return _view(name, path("series", *place), end, (0.0, top), legend)


def _log_plot(name: str, place: tuple[str, ...], end: float) -> rrb.TimeSeriesView:
    return _view(name, path(*LOG, *place), end, None, legend=True)


def _view(name: str, origin: str, end: float, span: tuple[float, float] | None, legend: bool) -> rrb.TimeSeriesView:
    whole = rr.TimeRange(
        start=rr.TimeRangeBoundary.absolute(seconds=0.0),
        end=rr.TimeRangeBoundary.absolute(seconds=end * (BESIDE_LEGEND if legend else BESIDE)),
    )
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=rrb.TimeAxis(view_range=whole),
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
        plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.RightTop, visible=legend),
    )


def _values(table: pa.Table, name: str) -> Array:
    """A column; none where every tracker failed."""
    return table.column(name).to_numpy() if table.num_rows else np.empty(0)


def _top(values: Array, bound: Array | None = None) -> float:
    """Where an axis ends so that neither the start of a track nor one bad tracker flattens everything else."""
    finite = values[np.isfinite(values)]
    top = 1.2 * float(np.percentile(finite, 97)) if len(finite) else 1.0
    if bound is not None and np.isfinite(bound).any():
        limit = float(np.nanmedian(bound))
        top = float(np.clip(top, 1.5 * limit, 4.0 * limit))
    return top
