"""The tracks of the recorded run from above, with what went wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.errors import counted
from trackbench.document import Figure, LegendEntry, TrackerStyle
from trackbench.document.drawing import INK, MUTED, WIDTH, panel_title
from trackbench.document.palette import ERROR_COLOURS
from trackbench.metrics.track_events import TrackEvent, events_of
from trackbench.report.numbers import joined
from trackbench.report.run.figures.ground import alive_path, box_around, draw_surroundings
from trackbench.report.run.figures.lines import column, names, where
from trackbench.report.run.figures.map import mapped
from trackbench.results import Result

_LOST, _FALSE = ERROR_COLOURS[4], "#B42D00"
#: Marks of events, each with its colour and whether it is filled.
MARKS = {
    "switched": ("x", INK, "none"),
    "lost": ("o", _LOST, "none"),
    "merged": ("o", _LOST, "none"),
    "false": ("^", _FALSE, _FALSE),
}


def map_of_tracks(result: Result, styles: Sequence[TrackerStyle]) -> Figure | None:
    """The tracks of the best and of the last ranked tracker, a panel each, over the true paths.

    Args:
        result: of the run.
        styles: of all scored trackers, best first.
    """
    truth, roads, run = result.tables.truth, result.tables.roads, result.summary.recorded_run
    shown = mapped(styles)
    targets = {name: alive_path(truth, name) for name in names(where(truth, role="target"), "object")}
    observer = [alive_path(truth, name) for name in names(where(truth, role="observer"), "object")]
    box = box_around([*targets.values(), *observer])
    if box is None or not shown:
        return None
    tracks = {style.key: _tracks(where(result.tables.tracks, tracker=style.name)) for style in shown}
    events = {style.key: events_of(result, style.name, run) for style in shown}
    beside = box.height > box.width
    across = WIDTH / len(shown) if beside else WIDTH
    height = box.drawn_height(across)

    def paint(canvas: Canvas) -> None:
        shape = (1, len(shown)) if beside else (len(shown), 1)
        every = list(canvas.subplots(*shape, sharex=True, sharey=True, squeeze=False).flat)
        for axes, style in zip(every, shown, strict=True):
            axes.grid(visible=False)
            draw_surroundings(axes, roads, observer, targets, box.points(across))
            panel_title(axes, style.name, across)
            for x, y in tracks[style.key].values():
                axes.plot(x, y, color=style.colour, linewidth=1.5)
            _marks(axes, events[style.key])
            axes.set(xlim=(box.left, box.right), ylim=(box.bottom, box.top), ylabel="y, m")
            if not box.stretched:
                axes.set_aspect("equal")
        every[-1].set_xlabel("x, m")

    said = [f"{style.name} {counted(len(tracks[style.key]), 'track')}" for style in shown]
    return Figure(
        "map",
        "Tracks from above",
        f"Run {run}, {_which(shown, len(styles))}: true paths in grey from the dot to the name, the observer's dotted; "
        "tracks in the tracker's colour." + (" The axes have different scales." if box.stretched else ""),
        f"Map of run {run}: {counted(len(targets), 'vehicle')}; {joined(said)}.",
        paint,
        30 + (height if beside else len(shown) * height),
        legend=(
            LegendEntry("true path", MUTED),
            LegendEntry("switch", INK, "cross"),
            LegendEntry("lost or merged", _LOST, "ring"),
            LegendEntry("false track begins", _FALSE, "triangle"),
        ),
    )


def _which(shown: Sequence[TrackerStyle], every: int) -> str:
    """Of the trackers, and where the others are."""
    names = joined([style.name for style in shown])
    return names if len(shown) == every else f"the best and the last ranked tracker, {names} (the recording has all)"


def _tracks(rows: pa.Table) -> Mapping[int, tuple[np.ndarray, np.ndarray]]:
    """``(points,)`` x and y of each track, m."""
    ids, x, y = (column(rows, name) for name in ("track", "px_m", "py_m"))
    return {int(each): (x[ids == each], y[ids == each]) for each in np.unique(ids)}


def _marks(axes: Axes, events: Sequence[TrackEvent]) -> None:
    for kind, (marker, colour, filled) in MARKS.items():
        own = [event for event in events if event.kind == kind]
        axes.plot(
            [event.x_m for event in own], [event.y_m for event in own], marker=marker, markersize=7, color=colour,
            markerfacecolor=filled, markeredgewidth=1.6, linestyle="none", zorder=5,
        )  # fmt: skip
