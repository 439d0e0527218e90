"""How a recording of tracks opens: the scene above, the charts and the log of events below it."""

from __future__ import annotations

from collections.abc import Sequence

import rerun.blueprint as rrb

from trackbench.document.replay import Chart
from trackbench.subjects.recording.charts import origin
from trackbench.subjects.recording.contents import Contents
from trackbench.subjects.recording.focus import Focus
from trackbench.subjects.recording.layout import beside, opened
from trackbench.subjects.recording.plots import plot
from trackbench.subjects.recording.scene import MEASUREMENTS
from trackbench.subjects.recording.stream import path
from trackbench.subjects.recording.tracks.legend import track_entries
from trackbench.subjects.recording.tracks.scene import ASSOCIATIONS, entities, others
from trackbench.subjects.recording.trails import TRAIL_S, TRUE
from trackbench.subjects.recording.views import RECENT_S, Window, scene_view

EVENTS = "events"


def blueprint(contents: Contents, charts: Sequence[Chart], wide: Window, focus: Focus) -> rrb.Blueprint:
    """The layout of a recording of tracks: a tab for each tracker, the one in focus or else the best in front."""
    text = rrb.Tabs(
        rrb.TextDocumentView(origin="ranking", name="Ranking"),
        rrb.TextDocumentView(origin="about", name="About this run"),
    )
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
    return opened(beside(main, track_entries(contents.colours, list(contents.sensors)), text), focus)


def _view(contents: Contents, window: Window, tracker: str, name: str, gates: bool = False) -> rrb.Spatial2DView:
    """The scene with one tracker's tracks, and with their gates and the detections that they took."""
    shown = {path(*MEASUREMENTS, sensor): RECENT_S for sensor in contents.sensors}
    own = entities(tracker)
    if gates:
        own |= {path(*ASSOCIATIONS, tracker, *part): 0.0 for part in ((), ("detections",), ("gates",))}
    shown |= {path(*TRUE): TRAIL_S, **own}
    return scene_view(window, name, shown, *others(), *(f"+ {entity}" for entity in own))
