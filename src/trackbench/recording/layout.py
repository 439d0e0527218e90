"""How a recording opens: the scene above, the scores below it, the ranked table beside them."""

from __future__ import annotations

from typing import Any

import rerun.blueprint as rrb

from trackbench.recording.contents import Contents
from trackbench.recording.plots import live_plots, plots
from trackbench.recording.stream import TIMELINE
from trackbench.recording.views import Window, scene_views


def blueprint(contents: Contents, windows: list[Window]) -> rrb.Blueprint:
    """The layout of a recording."""
    text = rrb.Vertical(
        rrb.TextDocumentView(origin="ranking", name="Ranking"),
        rrb.TextDocumentView(origin="about", name="About this run"),
    )
    scene = scene_views(windows, list(contents.sensors))
    main = rrb.Vertical(scene, plots(contents), row_shares=[4, 5])
    return played(rrb.Horizontal(main, text, column_shares=[5, 2]))


def played(container: rrb.Container) -> rrb.Blueprint:
    """A layout that plays from the start, again and again."""
    return _blueprint(container, play_state="playing", loop_mode="all")


def live_blueprint(windows: list[Window], sensors: list[str]) -> rrb.Blueprint:
    """The layout while a run goes on, of which only the recorded run is known: it follows the trackers."""
    container = rrb.Vertical(scene_views(windows, sensors), live_plots(), row_shares=[3, 2])
    return _blueprint(container, play_state="following")


def _blueprint(container: rrb.Container, **playing: Any) -> rrb.Blueprint:
    time = rrb.TimePanel(state="collapsed", timeline=TIMELINE, **playing)
    return rrb.Blueprint(container, time, collapse_panels=True, auto_views=False)
