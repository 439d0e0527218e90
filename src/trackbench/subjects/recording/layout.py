"""How a recording opens: the scene above, the scores below it, legend and ranked table beside them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import rerun.blueprint as rrb

from trackbench.document.replay import Chart, NamedColour
from trackbench.subjects.recording import legend
from trackbench.subjects.recording.contents import Contents
from trackbench.subjects.recording.focus import Focus
from trackbench.subjects.recording.plots import live_plots, origin, plot, plots
from trackbench.subjects.recording.scene import MEASUREMENTS, TRAIL_S, TRUE
from trackbench.subjects.recording.series import AllCharts
from trackbench.subjects.recording.stream import TIMELINE, path
from trackbench.subjects.recording.track_scene import ASSOCIATIONS, entities, others
from trackbench.subjects.recording.views import RECENT_S, Window, scene_view, scene_views

#: How many vehicles have plots and a close-up of their own.
MOST_VEHICLES = 6
#: Pixels of a window for what is beside the scene.
BESIDE = 850.0
WHOLE = Focus()
EVENTS = "events"


def blueprint(contents: Contents, charts: AllCharts, wide: Window, focus: Focus = WHOLE) -> rrb.Blueprint:
    """The layout of a recording."""
    vehicles = _shown(contents.vehicles, focus)
    scene = scene_views(wide, vehicles, contents.sensors, contents.colours, focus)
    main = rrb.Vertical(scene, plots(contents, charts, vehicles, focus), row_shares=[4, 5])
    return opened(beside(main, legend.entries(contents.colours, list(contents.sensors)), _texts()), focus)


def track_blueprint(contents: Contents, charts: Sequence[Chart], wide: Window, focus: Focus) -> rrb.Blueprint:
    """The layout of a recording of tracks: a tab for each tracker, the one in focus or else the best in front."""
    # With nothing in focus a close view would show a place where nobody may be.
    window = near = wide
    if focus.vehicle is not None:
        window = wide.around(focus.vehicle)
        near = window.closer(focus.beside)
    trackers = list(contents.colours)
    front = focus.tracker if focus.tracker in trackers else contents.best
    tabs = rrb.Tabs(
        *(
            rrb.Horizontal(
                _view(contents, window, name, f"Tracks of {name}"),
                _view(contents, near, name, f"Gates and associations of {name}", gates=True),
                column_shares=[2, 1],
                name=name,
            )
            for name in trackers
        ),
        active_tab=trackers.index(front) if front in trackers else 0,
    )
    parts = [plot(chart.title, origin(chart), chart.span(chart.largest)) for chart in charts]
    log = rrb.TextLogView(origin=EVENTS, name="Events")
    below = rrb.Horizontal(
        rrb.Tabs(*parts[:-1], active_tab=0), rrb.Tabs(log, parts[-1], active_tab=0), column_shares=[1, 1]
    )
    main = rrb.Vertical(tabs, below, row_shares=[3, 2]) if trackers else below
    return opened(beside(main, legend.track_entries(contents.colours, list(contents.sensors)), _texts()), focus)


def _view(contents: Contents, window: Window, tracker: str, name: str, gates: bool = False) -> rrb.Spatial2DView:
    """The scene with one tracker's tracks, and with their gates and the detections that they took."""
    shown = {path(*MEASUREMENTS, sensor): RECENT_S for sensor in contents.sensors}
    own = entities(tracker)
    if gates:
        own |= {path(*ASSOCIATIONS, tracker, *part): 0.0 for part in ((), ("detections",), ("gates",))}
    shown |= {path(*TRUE): TRAIL_S, **own}
    return scene_view(window, name, shown, *others(), *(f"+ {entity}" for entity in own))


def _texts() -> rrb.Container:
    return rrb.Tabs(
        rrb.TextDocumentView(origin="ranking", name="Ranking"),
        rrb.TextDocumentView(origin="about", name="About this run"),
    )


def opened(container: rrb.Container, focus: Focus) -> rrb.Blueprint:
    """A layout that stops at the time in focus, or plays."""
    return played(container) if focus.time_s is None else _blueprint(container, play_state="paused")


def played(container: rrb.Container) -> rrb.Blueprint:
    """A layout that plays from the start, again and again."""
    return _blueprint(container, play_state="playing", loop_mode="all")


def live_blueprint(wide: Window, vehicles: list[str], sensors: Iterable[str], colours: dict[str, str]) -> rrb.Blueprint:
    """The layout while a run goes on, of which only the recorded run is known: it follows the trackers."""
    scene = scene_views(wide, _shown(vehicles, WHOLE), sensors, colours, WHOLE)
    main = rrb.Vertical(scene, live_plots(), row_shares=[3, 2])
    return _blueprint(beside(main, legend.entries(colours, list(sensors))), play_state="following")


def _shown(vehicles: list[str], focus: Focus) -> list[str]:
    first = vehicles[:MOST_VEHICLES]
    return first if focus.vehicle is None or focus.vehicle in first else [*first[:-1], focus.vehicle]


def beside(
    main: rrb.Container, entries: list[NamedColour], text: rrb.Container | rrb.View | None = None
) -> rrb.Container:
    """A container with the legend on its right, and texts under that."""
    names = legend.legend_view(entries)
    share = legend.height(entries) / BESIDE
    side = names if text is None else rrb.Vertical(names, text, row_shares=[share, 1 - share])
    return rrb.Horizontal(main, side, column_shares=[3, 1])


def _blueprint(container: rrb.Container, **playing: Any) -> rrb.Blueprint:
    time = rrb.TimePanel(state="collapsed", timeline=TIMELINE, **playing)
    return rrb.Blueprint(container, time, collapse_panels=True, auto_views=False)
