"""How a recording opens: the scene above, the scores below it, the ranked table beside them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pyarrow as pa
import rerun.blueprint as rrb

from trackbench.recording.plots import live_plots, plots
from trackbench.recording.stream import TIMELINE
from trackbench.recording.views import Window, scene_views


def blueprint(summary: dict[str, Any], tables: Mapping[str, pa.Table], windows: list[Window]) -> rrb.Blueprint:
    """The layout for one run: it plays from the start, again and again."""
    text = rrb.Vertical(
        rrb.TextDocumentView(origin="ranking", name="Ranking"),
        rrb.TextDocumentView(origin="about", name="About this run"),
    )
    scene = scene_views(windows, list(summary["sensors"]))
    main = rrb.Vertical(scene, plots(summary, tables), row_shares=[4, 5])
    return rrb.Blueprint(
        rrb.Horizontal(main, text, column_shares=[5, 2]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="playing", loop_mode="all"),
        collapse_panels=True,
        auto_views=False,
    )


def live_blueprint(windows: list[Window], sensors: list[str]) -> rrb.Blueprint:
    """The layout while a run goes on, of which only the recorded run is known: it follows the trackers."""
    return rrb.Blueprint(
        rrb.Vertical(scene_views(windows, sensors), live_plots(), row_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        collapse_panels=True,
        auto_views=False,
    )
