"""How a recording opens: the scene above, the scores below it, legend and ranked table beside them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import rerun.blueprint as rrb

from trackbench.document.replay import NamedColour
from trackbench.subjects.recording import legend
from trackbench.subjects.recording.contents import Contents
from trackbench.subjects.recording.focus import Focus
from trackbench.subjects.recording.plots import live_plots, plots
from trackbench.subjects.recording.series import AllCharts
from trackbench.subjects.recording.stream import TIMELINE
from trackbench.subjects.recording.views import Window, scene_views

#: How many vehicles have plots and a close-up of their own.
MOST_VEHICLES = 6
#: Pixels of a window for what is beside the scene.
BESIDE = 850.0
WHOLE = Focus()


def blueprint(contents: Contents, charts: AllCharts, wide: Window, focus: Focus = WHOLE) -> rrb.Blueprint:
    """The layout of a recording."""
    vehicles = _shown(contents.vehicles, focus)
    text = rrb.Tabs(
        rrb.TextDocumentView(origin="ranking", name="Ranking"),
        rrb.TextDocumentView(origin="about", name="About this run"),
    )
    scene = scene_views(wide, vehicles, contents.sensors, contents.colours, focus)
    main = rrb.Vertical(scene, plots(contents, charts, vehicles, focus), row_shares=[4, 5])
    return opened(beside(main, legend.entries(contents.colours, list(contents.sensors)), text), focus)


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
