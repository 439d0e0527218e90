"""A map of a scene's paths from above, which an HTML page replaces by the replay of the scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.errors import counted
from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import GRID, INK, MUTED, WIDTH, panel_title, shortened_to_width
from trackbench.document.replay import ReplayPath, ReplayScene

#: A scene longer than this many times its width, such as a straight road, is drawn with a larger scale across.
ELONGATED = 4.0
#: Largest height of a panel, and the height of an elongated scene's panel, points.
TALLEST, STRETCHED = 400.0, 150.0
#: Width at which the name of an object is shortened, points.
NAME = 90.0

_Look = dict[str, Any]
_RING: _Look = {"marker": "o", "markersize": 7, "color": INK, "markerfacecolor": "none", "markeredgewidth": 1.6}
#: Mark of each kind of event, distinct by shape, as colours stand for trackers.
MARKS: dict[str, _Look] = {
    "worst": {**_RING, "markersize": 12},
    "switched": {**_RING, "marker": "x"},
    "lost": _RING,
    "merged": _RING,
    "false": {**_RING, "marker": "^"},
}
#: Entry of the legend for kinds of events.
_LEGEND = {
    ("worst",): LegendEntry("largest error", INK, "ring"),
    ("switched",): LegendEntry("switch", INK, "cross"),
    ("lost", "merged"): LegendEntry("lost or merged", INK, "ring"),
    ("false",): LegendEntry("false track begins", INK, "triangle"),
}


def map_of_scene(scene: ReplayScene, caption: str, name: str = "map") -> Figure:
    """Return a map with a panel for each tracker in ``scene.shown``: true paths, its estimates and events.

    Args:
        scene: scene that is drawn, and that an HTML page plays.
        caption: text of the caption, which follows the explanation of the lines.
        name: name of the figure's file.
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
        all_axes = list(canvas.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
        for axes in all_axes:
            _draw_truth(axes, scene, vehicles)
            axes.set(xlim=(left, right), ylim=(bottom, top), ylabel="y, m")
            if not is_stretched:
                axes.set_aspect("equal")
        for axes, tracker in zip(all_axes, shown, strict=False):
            panel_title(axes, tracker.name, across)
            for path in estimates[tracker.name]:
                axes.plot(*path.position, color=path.colour, linewidth=1.2)
            for event in marks:
                if event.tracker == tracker.name:
                    axes.plot(event.x_m, event.y_m, zorder=5, **MARKS[event.kind])
        all_axes[-1].set_xlabel("x, m")

    lines = "True paths in grey from the dot to the name, the observer's dotted"
    lines += "; estimates or tracks in the tracker's colour." if shown else "."
    counts = ", ".join(f"{name}: {counted(len(paths), 'path')}" for name, paths in estimates.items())
    return Figure(
        name,
        "From above",
        f"{lines} {caption}".rstrip() + " The axes have different scales." * is_stretched,
        f"Map of {counted(sum(not path.is_observer for path in vehicles), 'vehicle')}. {counts}".rstrip(),
        paint,
        30 + rows * height,
        legend=tuple(entry for kinds, entry in _LEGEND.items() if any(event.kind in kinds for event in scene.events)),
        replay=scene,
    )


def _draw_truth(axes: Axes, scene: ReplayScene, vehicles: Sequence[ReplayPath]) -> None:
    """Paint the edges of road lanes, the observer's path, and the objects' paths with their names, on ``axes``."""
    axes.grid(visible=False)
    for lane in scene.lanes:
        axes.plot(*lane, color=GRID, linewidth=1.5)
    for path in vehicles:
        start, (x, y) = path.position[:, :1], path.position[:, -1].tolist()
        if path.is_observer:
            axes.plot(*path.position, color=MUTED, linewidth=1.4, linestyle=(0, (1.5, 1.5)))
            axes.plot(*start, color=MUTED, marker="s", markersize=5)
            continue
        axes.plot(*path.position, color=MUTED, linewidth=3.0, alpha=0.5)
        axes.plot(*start, color=INK, marker="o", markersize=3.5)
        text = shortened_to_width(path.name, NAME, 9)
        axes.annotate(text, (x, y), xytext=(3, 3), textcoords="offset points", fontsize=9)
