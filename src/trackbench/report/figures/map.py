"""A scene from above: a still map of its paths, which a page replaces by the replay of the scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.errors import counted
from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import GRID, INK, MUTED, WIDTH, panel_title, shortened_to_width
from trackbench.document.palette import OBSERVER_COLOUR
from trackbench.document.replay import ReplayPath, ReplayScene
from trackbench.results.columns import Columns

#: A scene longer than this many times its width (a straight road) is drawn stretched across.
ELONGATED = 4.0
#: Height of a panel, points.
TALLEST, STRETCHED = 400.0, 150.0
#: The widest name of an object, points.
NAME = 90.0

_Look = dict[str, Any]
_RING: _Look = {"marker": "o", "markersize": 7, "color": INK, "markerfacecolor": "none", "markeredgewidth": 1.6}
#: How each kind of event is marked, and the largest error: by its shape alone, a colour is a tracker's.
MARKS: dict[str, _Look] = {
    "worst": {**_RING, "markersize": 12},
    "switched": {**_RING, "marker": "x"},
    "lost": _RING,
    "merged": _RING,
    "false": {**_RING, "marker": "^"},
}
#: The entries of the legend by the kinds of events that they explain.
_LEGEND = {
    ("worst",): LegendEntry("largest error", INK, "ring"),
    ("switched",): LegendEntry("switch", INK, "cross"),
    ("lost", "merged"): LegendEntry("lost or merged", INK, "ring"),
    ("false",): LegendEntry("false track begins", INK, "triangle"),
}


def path_of(rows: Columns) -> tuple[Array, Array]:
    """Return x and y, m, of the path of an object or track, of an object while it is in the scene."""
    there = np.asarray(rows.get("alive", np.ones(len(rows["px_m"]))), dtype=bool)
    return rows["px_m"][there], rows["py_m"][there]


def map_of_scene(scene: ReplayScene, caption: str, name: str = "map") -> Figure:
    """Return the true paths and, in a panel for each tracker that is shown at first, its estimates and events over
    them.

    Args:
        scene: what is drawn, and played in a page.
        caption: after what the lines are.
        name: of the figure.
    """
    shown = [tracker for tracker in scene.trackers if tracker.name in scene.shown]
    vehicles = [path for path in scene.paths if not path.tracker]
    estimates = {tracker.name: [path for path in scene.paths if path.tracker == tracker.name] for tracker in shown}
    (left, right), (bottom, top) = scene.x_range, scene.y_range
    is_tall, is_stretched = top - bottom > right - left, right - left > ELONGATED * (top - bottom)
    panels = max(1, len(shown))
    rows, columns = (1, panels) if is_tall else (panels, 1)
    across = WIDTH / columns
    height = STRETCHED if is_stretched else min(TALLEST, 30 + (across - 50) * (top - bottom) / (right - left))
    marks = [event for event in scene.events if event.tracker in estimates]

    def paint(canvas: Canvas) -> None:
        every = list(canvas.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
        for axes in every:
            _draw_truth(axes, scene, vehicles)
            axes.set(xlim=(left, right), ylim=(bottom, top), ylabel="y, m")
            if not is_stretched:
                axes.set_aspect("equal")
        for axes, tracker in zip(every, shown, strict=False):
            panel_title(axes, tracker.name, across)
            for path in estimates[tracker.name]:
                axes.plot(*path.position, color=path.colour, linewidth=1.2)
            for event in marks:
                if event.tracker == tracker.name:
                    look = MARKS[event.kind]
                    axes.plot(event.x_m, event.y_m, zorder=5, gid=f"{event.kind}-{tracker.key}", **look)
        every[-1].set_xlabel("x, m")

    lines = "True paths in grey from the dot to the name, the observer's dotted"
    lines += "; estimates or tracks in the tracker's colour." if shown else "."
    counts = ", ".join(f"{name}: {counted(len(paths), 'path')}" for name, paths in estimates.items())
    return Figure(
        name,
        "From above",
        f"{lines} {caption}".rstrip() + " The axes have different scales." * is_stretched,
        f"Map of {counted(sum(path.colour != OBSERVER_COLOUR for path in vehicles), 'vehicle')}. {counts}".rstrip(),
        paint,
        30 + rows * height,
        legend=tuple(entry for kinds, entry in _LEGEND.items() if any(event.kind in kinds for event in scene.events)),
        tooltips={f"worst-{t.key}": e.text for t in shown for e in marks if (e.tracker, e.kind) == (t.name, "worst")},
        replay=scene,
    )


def _draw_truth(axes: Axes, scene: ReplayScene, vehicles: Sequence[ReplayPath]) -> None:
    """Draw the edges of lanes, the path of the observer and those of the objects, with their names."""
    axes.grid(visible=False)
    for lane in scene.lanes:
        axes.plot(*lane, color=GRID, linewidth=1.5)
    for path in vehicles:
        start, (x, y) = path.position[:, :1], path.position[:, -1].tolist()
        if path.colour == OBSERVER_COLOUR:
            axes.plot(*path.position, color=MUTED, linewidth=1.4, linestyle=(0, (1.5, 1.5)))
            axes.plot(*start, color=MUTED, marker="s", markersize=5)
            continue
        axes.plot(*path.position, color=MUTED, linewidth=3.0, alpha=0.5)
        axes.plot(*start, color=INK, marker="o", markersize=3.5)
        text = shortened_to_width(path.name, NAME, 9)
        axes.annotate(text, (x, y), xytext=(3, 3), textcoords="offset points", fontsize=9)
