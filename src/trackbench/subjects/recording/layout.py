"""The layout with which a recording opens: the scene above, the plots below, legend and ranking beside them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis

from trackbench.base.errors import counted
from trackbench.document import LegendEntry
from trackbench.document.palette import BOUND_COLOUR, IDENTITY_COLOURS, OBSERVER_COLOUR, sensor_colours
from trackbench.document.replay import Chart
from trackbench.subjects.recording import functions
from trackbench.subjects.recording.contents import Contents
from trackbench.subjects.recording.focus import Focus
from trackbench.subjects.recording.scene import MEASUREMENTS, TRAIL_S, TRUE_TRAILS
from trackbench.subjects.recording.series import NOTHING, AllCharts, Charts, recorded_run
from trackbench.subjects.recording.stream import TIMELINE, Stream, path, pixels, rgba, send_line
from trackbench.subjects.recording.tracks import (
    ASSOCIATION_COLOUR,
    ASSOCIATIONS,
    MARKED,
    MISSED,
    entities_of_tracker,
    tracker_families,
)
from trackbench.subjects.recording.views import BACKGROUND, RECENT_S, Window, maps_view, scene_view, scene_views

LEGEND = "legend"
#: Width of the legend, of a letter, and of the room around a name, pixels.
WIDTH, LETTER, AROUND = 380.0, 7.0, 26.0
ROW, MARK, RING = 40.0, 22.0, 6.0


def entries(trackers: Mapping[str, str], sensors: Sequence[str], hidden: bool = False) -> list[LegendEntry]:
    """Return the legend of scene and plots: trackers, measurements of each sensor, truth, observer and marks.

    With ``hidden`` identities the trackers' colours appear in the plots alone.
    """
    tracks = [
        LegendEntry("tracks", IDENTITY_COLOURS[0], "dot"),
        LegendEntry("due, no track", MISSED, "ring"),
        LegendEntry("false track", MARKED["false"], "cross"),
        LegendEntry("lost, merged", MARKED["lost"], "cross"),
        LegendEntry("switch", MARKED["switched"], "cross"),
        LegendEntry("association", ASSOCIATION_COLOUR),
    ]
    return [
        *(LegendEntry(name, colour) for name, colour in trackers.items()),
        *(LegendEntry(name, colour, "dot") for name, colour in sensor_colours(sensors).items()),
        LegendEntry("truth" if hidden else "truth, reference", BOUND_COLOUR),
        LegendEntry("observer", OBSERVER_COLOUR),
        *(tracks if hidden else ()),
    ]


def entries_of(contents: Contents) -> list[LegendEntry]:
    return entries(contents.colours, list(contents.sensors), contents.hidden)


def send_legend(stream: Stream, shown: list[LegendEntry]) -> None:
    """Send the legend: rows of names, each below a line, a dot or a ring."""
    for number, (entry, x, y) in enumerate(_with_positions(shown)):
        style: dict[str, Any] = {"colors": rgba(entry.colour), "labels": entry.label, "show_labels": True}
        if entry.mark == "line":
            mark: rr.AsComponents = rr.LineStrips2D(
                [[(x - MARK / 2, y), (x + MARK / 2, y)]], radii=pixels(1.5), **style
            )
        elif entry.mark == "ring":
            angle = np.linspace(0, 2 * np.pi, 25)
            ring = np.stack([x + RING * np.cos(angle), y + RING * np.sin(angle)], axis=1)
            mark = rr.LineStrips2D([ring], radii=pixels(1.5), **style)
        else:
            mark = rr.Points2D([(x, y)], radii=pixels(5.0 if entry.mark == "cross" else 3.0), **style)
        stream.static(path(LEGEND, str(number)), mark)


def legend_view(shown: list[LegendEntry]) -> rrb.Spatial2DView:
    """Return the viewer's panel that shows the legend of the entries ``shown``."""
    return rrb.Spatial2DView(
        origin=LEGEND,
        name="Legend",
        visual_bounds=rrb.VisualBounds2D(x_range=(0.0, WIDTH), y_range=(0.0, height(shown))),
        background=BACKGROUND,
    )


def height(shown: list[LegendEntry]) -> float:
    """Return the height of the legend in pixels."""
    return max(y for _, _, y in _with_positions(shown)) + 0.9 * ROW


def _with_positions(shown: list[LegendEntry]) -> Iterator[tuple[LegendEntry, float, float]]:
    """Yield each entry with the middle of its mark, pixels, in columns as wide as the longest name."""
    longest = max(len(entry.label) for entry in shown)
    columns = max(1, min(len(shown), int(WIDTH / (LETTER * longest + AROUND))))
    row, column = np.divmod(np.arange(len(shown)), columns)
    for entry, i, k in zip(shown, row, column, strict=True):
        yield entry, float((k + 0.5) * WIDTH / columns), float((i + 0.25) * ROW)


SERIES = "series"
#: Ratio of the time axis' end to the end of the lines.
ROOM = 1.05


def send_chart(stream: Stream, chart: Chart) -> None:
    for line in (*chart.lines, *chart.bounds):
        # A missing value after the end leaves room for the last label of the time axis.
        time, value = np.append(line.time, line.time[-1:] * ROOM), np.append(line.value, line.value[-1:] * np.nan)
        entity = path(SERIES, *chart.place, *line.entity)
        send_line(stream, entity, time, value, line.name, line.colour, line.width)


def _page(charts: Charts, name: str, shown: float = 0.0) -> rrb.Container:
    """Return a tab with the plots of errors, NEES, NIS and modes; ``shown`` is a position error, m, to be visible."""
    position, velocity = charts.errors
    tabs = [rrb.Tabs(*map(plot, group)) for group in (charts.nis, charts.modes) if group]
    return rrb.Horizontal(
        rrb.Vertical(plot(position, shown), plot(velocity)), rrb.Vertical(plot(charts.nees), *tabs), name=name
    )


def plot(chart: Chart, shown: float = 0.0, *, whole: bool = False) -> rrb.TimeSeriesView:
    """Return the view of a chart; all charts share the time axis.

    The value axis includes the value ``shown``, or all values if ``whole``. The view has no legend of trackers, which
    would cover lines; the page has one.
    """
    return rrb.TimeSeriesView(
        origin=path(SERIES, *chart.place),
        name=chart.title,
        axis_x=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
        axis_y=None if whole else rrb.ScalarAxis(range=chart.span(shown)),
        plot_legend=rrb.PlotLegend(visible=chart.share),
    )


#: Largest number of vehicles that have plots and a close-up.
MOST_VEHICLES = 6
#: Height of the column beside the scene, pixels.
BESIDE = 850.0
WHOLE = Focus()
COSTS = "costs"


def blueprint(contents: Contents, charts: AllCharts, wide: Window, focus: Focus = WHOLE) -> rrb.Blueprint:
    """Return the layout with known identities: tabs for all runs, the recorded run and each vehicle."""
    vehicles = _vehicles_with_plots(contents.vehicles, focus)
    scene = scene_views(wide, vehicles, contents.sensors, contents.colours, focus, contents.moment.vehicle)
    runs = _page(charts.all_runs, counted(contents.result.summary.runs, "run"))
    recorded = _page(charts.recorded, f"Run {contents.result.summary.recorded_run}, all vehicles")
    tabs: list[rrb.Container] = [
        _page(charts.vehicles[name], name, focus.error_m if name == focus.vehicle else 0.0) for name in vehicles
    ]
    tabs += [maps_view(contents.scene, contents.mapped)] if contents.mapped else []
    tab = 0 if focus.vehicle is None else 2 + vehicles.index(focus.vehicle)
    if contents.decisions.num_rows:
        tabs.append(rrb.Horizontal(functions.lanes_view(), name="Functions"))
        tab = len(tabs) + 1 if focus.vehicle is None or focus.function is not None else tab
    main = rrb.Vertical(scene, rrb.Tabs(runs, recorded, *tabs, active_tab=tab), row_shares=[4, 5])
    return _complete(main, contents, focus)


def track_blueprint(contents: Contents, charts: Sequence[Chart], wide: Window, focus: Focus) -> rrb.Blueprint:
    """Return the layout with hidden identities: a tab for each tracker, in front the one in focus or the best one."""
    # Without a vehicle in focus, a close view might show an empty place.
    window = close = wide
    if focus.vehicle is not None:
        window = wide.around(focus.vehicle)
        close = window.closer(focus.offset)
    trackers = list(contents.colours)
    best = next((tracker.name for tracker in contents.result.contenders), None)
    front = focus.tracker if focus.tracker in trackers else best
    tabs = rrb.Tabs(
        *(
            rrb.Horizontal(
                _tracker_view(contents, window, name, f"Tracks of {name}"),
                _tracker_view(contents, close, name, f"Gates and associations of {name}", gates=True),
                column_shares=[2, 1],
                name=name,
            )
            for name in trackers
        ),
        active_tab=trackers.index(front) if front in trackers else 0,
    )
    parts = [plot(chart, chart.largest) for chart in charts]
    lanes = [functions.lanes_view()] if contents.decisions.num_rows else []
    costs = rrb.TextDocumentView(origin=COSTS, name="Events by cost")
    below = rrb.Horizontal(rrb.Tabs(*lanes, *parts, active_tab=0), costs)
    main = rrb.Vertical(tabs, below, row_shares=[3, 2]) if trackers else below
    return _complete(main, contents, focus)


def _tracker_view(contents: Contents, view: Window, tracker: str, name: str, gates: bool = False) -> rrb.Spatial2DView:
    """Return a view of one tracker's tracks; ``gates`` adds their gates and associated detections."""
    shown = {path(*MEASUREMENTS, sensor): RECENT_S for sensor in contents.sensors}
    own_entities = entities_of_tracker(tracker)
    if gates:
        own_entities |= {path(*ASSOCIATIONS, tracker, *part): 0.0 for part in ((), ("gates",))}
    shown |= {path(*TRUE_TRAILS): TRAIL_S, **own_entities}
    left_out = (f"- {family}/**" for family in tracker_families())
    return scene_view(view, name, shown, *left_out, *(f"+ {entity}" for entity in own_entities))


def _complete(main: rrb.Container, contents: Contents, focus: Focus) -> rrb.Blueprint:
    texts = rrb.Tabs(
        rrb.TextDocumentView(origin="ranking", name="Ranking"),
        rrb.TextDocumentView(origin="about", name="About this run"),
    )
    shown = with_legend(main, entries_of(contents), texts)
    return with_time_panel(shown, "playing" if focus.time_s is None else "paused", contents.moment.time_s)


def live_blueprint(wide: Window, vehicles: list[str], sensors: Iterable[str], colours: dict[str, str]) -> rrb.Blueprint:
    """Return the layout of a live view, which follows the trackers while the run goes on."""
    scene = scene_views(wide, _vehicles_with_plots(vehicles, WHOLE), sensors, colours, WHOLE)
    empty = recorded_run(NOTHING, NOTHING, NOTHING, NOTHING, {})
    below = rrb.Horizontal(*(plot(chart, whole=True) for chart in (*empty.errors, empty.nees)))
    main = rrb.Vertical(scene, below, row_shares=[3, 2])
    return with_time_panel(with_legend(main, entries(colours, list(sensors))), "following")


def _vehicles_with_plots(vehicles: list[str], focus: Focus) -> list[str]:
    first = vehicles[:MOST_VEHICLES]
    return first if focus.vehicle is None or focus.vehicle in first else [*first[:-1], focus.vehicle]


def with_legend(
    main: rrb.Container, shown: list[LegendEntry], text: rrb.Container | rrb.View | None = None
) -> rrb.Container:
    """Return a container with the legend on the right, and texts below the legend."""
    names = legend_view(shown)
    share = height(shown) / BESIDE
    side = names if text is None else rrb.Vertical(names, text, row_shares=[share, 1 - share])
    return rrb.Horizontal(main, side, column_shares=[3, 1])


#: Time before and after a moment that is marked and repeated, s.
BEFORE_S, AFTER_S = 3.0, 3.0


def with_time_panel(
    container: rrb.Container, play_state: Literal["playing", "paused", "following"], moment: float | None = None
) -> rrb.Blueprint:
    """Return a layout with a time panel, which loops over the whole time, or over the time around ``moment`` (s)."""
    loop: dict[str, Any] = {"loop_mode": "all"} if play_state == "playing" else {}
    if moment is not None:
        ends = (round(1e9 * max(0.0, moment - BEFORE_S)), round(1e9 * (moment + AFTER_S)))
        loop = {"loop_mode": "selection", "time_selection": rr.encodings.AbsoluteTimeRange(*ends)}
    time = rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state=play_state, **loop)
    return rrb.Blueprint(container, time, collapse_panels=True, auto_views=False)
