"""Map of the recorded run: what trackers estimated over the true paths, and where they went wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.errors import InputError, counted
from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry, TrackerStyle
from trackbench.document.drawing import GRID, INK, MUTED, WIDTH, panel_title, shortened_to_width
from trackbench.metrics.function_events import events_of
from trackbench.metrics.recorded_run import EstimateMoment
from trackbench.report.moments import moment_text
from trackbench.report.numbers import joined_names
from trackbench.results import Result
from trackbench.results.columns import Columns, split, table_columns

#: A scene longer than this many times its width (a straight road) is drawn stretched across.
ELONGATED = 4.0
MARGIN_M = 6.0
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
_LEGEND = {
    "known": (LegendEntry("largest error", INK, "ring"),),
    "hidden": (
        LegendEntry("switch", INK, "cross"),
        LegendEntry("lost or merged", INK, "ring"),
        LegendEntry("false track begins", INK, "triangle"),
    ),
}

#: ``(points,)`` x and y, m.
Path = tuple[Array, Array]


def path_of(rows: Columns) -> Path:
    """Return the path of an object or track, of an object while it is in the scene."""
    there = np.asarray(rows.get("alive", np.ones(len(rows["px_m"]))), dtype=bool)
    return rows["px_m"][there], rows["py_m"][there]


def styles_with_map(styles: Sequence[TrackerStyle]) -> list[TrackerStyle]:
    """The trackers that have a map: the best and the last of those given."""
    return list(dict.fromkeys([styles[0], styles[-1]])) if styles else []


def map_of_run(result: Result, styles: Sequence[TrackerStyle], moments: Mapping[str, EstimateMoment]) -> Figure | None:
    """True paths, and over them the estimates or tracks of the best and of the last ranked tracker, a panel each.

    Args:
        result: of the run.
        styles: of the trackers that filter, best first.
        moments: by tracker, the worst, which is marked where identities are known.

    Returns:
        The figure; None without a path or a track.

    Raises:
        InputError: the tables are not those of one run.
    """
    tables, summary, drawn = result.tables, result.summary, styles_with_map(styles)
    motions = split(tables.truth, "object", "role")
    targets = {name: path_of(rows) for (name, role), rows in motions.items() if role == "target"}
    observer = [path_of(rows) for (_, role), rows in motions.items() if role == "observer"]
    every_path = [*targets.values(), *observer]
    x, y = (np.concatenate([np.empty(0), *(path[axis] for path in every_path)]) for axis in (0, 1))
    hidden = summary.identities == "hidden"
    if not x.size or (hidden and not drawn):
        return None
    stated, key = (tables.tracks, "track") if hidden else (tables.estimates, "object")
    stated_paths = split(stated, "tracker", key) if drawn else {}
    estimates = [[path_of(rows) for (name, _), rows in stated_paths.items() if name == style.name] for style in drawn]
    marks = [_marks(result, style.name, moments.get(style.name)) for style in drawn]
    left, right, bottom, top = x.min() - MARGIN_M, x.max() + MARGIN_M, y.min() - MARGIN_M, y.max() + MARGIN_M
    is_tall, is_stretched = bool(top - bottom > right - left), bool(right - left > ELONGATED * (top - bottom))
    titles = [style.name for style in drawn] or [""]
    rows, columns = (1, len(titles)) if is_tall else (len(titles), 1)
    across = WIDTH / columns
    height = STRETCHED if is_stretched else min(TALLEST, 30 + (across - 50) * (top - bottom) / (right - left))

    def paint(canvas: Canvas) -> None:
        every = list(canvas.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
        for axes, title in zip(every, titles, strict=True):
            _draw_truth(axes, tables.roads, observer, targets)
            panel_title(axes, title, across)
            axes.set(xlim=(left, right), ylim=(bottom, top), ylabel="y, m")
            if not is_stretched:
                axes.set_aspect("equal")
        for axes, style, paths, own in zip(every, drawn, estimates, marks, strict=False):
            for path in paths:
                axes.plot(*path, color=style.colour, linewidth=1.2)
            for kind, places in own.items():
                axes.plot(*places, linestyle="none", zorder=5, gid=f"{kind}-{style.key}", **MARKS[kind])
        every[-1].set_xlabel("x, m")

    worst = {style.key: moment_text(moments[style.name]) for style in drawn if style.name in moments}
    what = f"{'tracks' if hidden else 'estimates'} of {joined_names([style.name for style in drawn])}"
    caption = (
        f"Run {summary.recorded_run} from above: true paths in grey from the dot to the name, the observer's dotted"
    )
    caption += f"; {what} in the tracker's colour." if drawn else "."
    caption += f" Largest errors: {'; '.join(worst.values())}." * bool(worst)
    counts = f", {what}: {' and '.join(counted(len(paths), 'path') for paths in estimates)}" * bool(drawn)
    return Figure(
        "map",
        "From above",
        caption + " The axes have different scales." * is_stretched,
        f"Map of run {summary.recorded_run}: {counted(len(targets), 'vehicle')}{counts}.",
        paint,
        30 + rows * height,
        legend=_LEGEND[summary.identities] if drawn else (),
        tooltips={f"worst-{key}": text for key, text in worst.items()},
    )


def _draw_truth(axes: Axes, roads: pa.Table, observer: Sequence[Path], targets: Mapping[str, Path]) -> None:
    """Roads, the observer's path and those of the objects, with their names."""
    axes.grid(visible=False)
    lines, x, y = table_columns(roads).values()
    for line in np.unique(lines):
        axes.plot(x[lines == line], y[lines == line], color=GRID, linewidth=1.5)
    for x, y in observer:
        axes.plot(x, y, color=MUTED, linewidth=1.4, linestyle=(0, (1.5, 1.5)))
        axes.plot(x[:1], y[:1], color=MUTED, marker="s", markersize=5)
    for name, (x, y) in targets.items():
        axes.plot(x, y, color=MUTED, linewidth=3.0, alpha=0.5)
        axes.plot(x[:1], y[:1], color=INK, marker="o", markersize=3.5)
        text = shortened_to_width(name, NAME, 9)
        axes.annotate(text, (x[-1], y[-1]), xytext=(3, 3), textcoords="offset points", fontsize=9)


def _marks(result: Result, tracker: str, moment: EstimateMoment | None) -> dict[str, Path]:
    """Return where each kind of event of a tracker was, or its largest error."""
    if result.summary.identities == "hidden":
        events = events_of(result, tracker, result.summary.recorded_run)
        own = {kind: [event for event in events if event.kind == kind] for kind in MARKS}
        return {kind: tuple(np.array([[e.x_m, e.y_m] for e in of]).T) for kind, of in own.items() if of}
    if moment is None:
        return {}
    rows = split(result.tables.truth, "object").get((moment.object,), {"time_s": np.empty(0)})
    step = int(np.searchsorted(rows["time_s"], moment.time_s - 1e-9))
    if step == len(rows["time_s"]):
        raise InputError(f"the estimates of {moment.object} go on after its truth: not the tables of one run")
    return {"worst": (rows["px_m"][[step]], rows["py_m"][[step]])}
