"""The plots: the entities of a chart, and how charts are laid out for all runs, the recorded run and its vehicles."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis

from trackbench.document.replay import Chart
from trackbench.subjects.recording.contents import Contents
from trackbench.subjects.recording.focus import Focus
from trackbench.subjects.recording.series import NOTHING, AllCharts, Charts, recorded_run
from trackbench.subjects.recording.stream import Stream, path, send_line
from trackbench.subjects.recording.text import all_runs

SERIES = "series"
#: Rerun 0.41 has no logarithmic axis, so what spans orders of magnitude is also there as decimal logarithms.
LOG10 = "log10"


def origin(chart: Chart) -> str:
    """The entity of the values."""
    return path(SERIES, *chart.place)


def log_origin(chart: Chart) -> str:
    """The entity of their decimal logarithms."""
    return path(SERIES, LOG10, *chart.place)


def send_chart(stream: Stream, chart: Chart) -> None:
    """The values, and their logarithms where the range is large."""
    for line in (*chart.lines, *chart.bounds):
        entity = path(SERIES, *chart.place, *line.entity)
        send_line(stream, entity, line.time, line.value, line.name, line.colour, line.width)
        if chart.large:
            logarithm = np.log10(np.where(line.value > 0, line.value, np.nan))
            entity = path(SERIES, LOG10, *chart.place, *line.entity)
            send_line(stream, entity, line.time, logarithm, line.name, line.colour, line.width)


def plots(contents: Contents, charts: AllCharts, vehicles: list[str], focus: Focus) -> rrb.Container:
    """A tab for all runs, one for the recorded run, and one for each vehicle in it.

    Args:
        contents: of the recording.
        charts: of the recording.
        vehicles: those that have a tab.
        focus: the vehicle whose tab is open.
    """
    runs = _page(charts.all_runs, all_runs(contents.runs))
    recorded = _page(charts.recorded, f"Run {contents.recorded_run}, all vehicles")
    own = [_page(charts.vehicles[name], name, focus.error_m if name == focus.vehicle else 0.0) for name in vehicles]
    tab = 0 if focus.vehicle is None else 2 + vehicles.index(focus.vehicle)
    return rrb.Tabs(runs, recorded, *own, active_tab=tab)


def live_plots() -> rrb.Container:
    """The errors and the NEES of the recorded run as they come."""
    empty = recorded_run(NOTHING, NOTHING, NOTHING, {})
    return rrb.Horizontal(*(plot(chart.title, origin(chart)) for chart in (*empty.errors, empty.nees)))


def _page(charts: Charts, name: str, shown: float = 0.0) -> rrb.Container:
    """Errors of position and velocity, NEES and the NIS of the sensors, each with its logarithms where it needs them.

    ``shown`` (m) is a position error that must be seen.
    """
    position, velocity = charts.errors
    left = rrb.Vertical(chart_tabs([position], shown), chart_tabs([velocity]))
    right = rrb.Vertical(chart_tabs([charts.nees]), *(chart_tabs(each) for each in (charts.nis, charts.modes) if each))
    return rrb.Horizontal(left, right, name=name)


def chart_tabs(charts: Iterable[Chart], shown: float = 0.0) -> rrb.Container:
    """Charts as tabs, and after them the logarithms of those whose range is large."""
    every = list(charts)
    plain = [plot(chart.title, origin(chart), chart.span(shown), chart.share) for chart in every]
    logarithms = [plot(chart.log_title, log_origin(chart)) for chart in every if chart.large]
    return rrb.Tabs(*plain, *logarithms, active_tab=0)


def plot(name: str, origin: str, span: tuple[float, float] | None = None, legend: bool = False) -> rrb.TimeSeriesView:
    """Its time axis is that of all other plots. Trackers are in the legend of the page; one here would cover curves."""
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
        plot_legend=rrb.PlotLegend(visible=legend),
    )
