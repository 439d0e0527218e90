"""Maps of the recorded run: the position error along true paths, and tracks with what went wrong."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.errors import InputError, counted
from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry, TrackerStyle
from trackbench.document.drawing import GRID, INK, MUTED, WIDTH, panel_title, shortened_to_width
from trackbench.document.palette import ERROR_COLOURS, error_labels, error_limits
from trackbench.metrics.function_events import events_of
from trackbench.metrics.recorded_run import EstimateMoment
from trackbench.report.figures.over_time import column, names_in_column, rows_where
from trackbench.report.moments import moment_text
from trackbench.report.numbers import joined_names
from trackbench.results import Result

#: A scene longer than this many times its width (a straight road) is drawn stretched across.
ELONGATED = 4.0
MARGIN_M = 6.0
#: Points.
TALLEST, STRETCHED = 400.0, 150.0
#: The widest name of an object, points.
NAME = 90.0
#: Of a letter and a line of a name, and where a name may stand above the end of its path, points.
LETTER, LINE = 5.2, 10.0
ABOVE = (3.0, -11.0, 14.0, -22.0, 25.0)


def draw_surroundings(
    axes: Axes,
    roads: pa.Table,
    observer: Sequence[tuple[Array, Array]],
    targets: Mapping[str, tuple[Array, Array]],
    points: tuple[float, float],
) -> None:
    """Roads, the observer's path and those of the objects, with their names; ``points`` are of a metre in x and y."""
    lines, x, y = (column(roads, name) for name in ("line", "x_m", "y_m"))
    for line in np.unique(lines):
        axes.plot(x[lines == line], y[lines == line], color=GRID, linewidth=1.5)
    for x, y in observer:
        axes.plot(x, y, color=MUTED, linewidth=1.4, linestyle=(0, (1.5, 1.5)))
        axes.plot(x[:1], y[:1], color=MUTED, marker="s", markersize=5)
    placed: list[tuple[float, float, float]] = []
    for name, (x, y) in targets.items():
        axes.plot(x, y, color=MUTED, linewidth=0.8)
        axes.plot(x[:1], y[:1], color=INK, marker="o", markersize=3.5)
        text = shortened_to_width(name, NAME, 9)
        left, at, width = x[-1] * points[0] + 3, y[-1] * points[1], LETTER * len(text)
        above = next((each for each in ABOVE if _free(left, at + each, width, placed)), ABOVE[0])
        placed.append((left, at + above, width))
        axes.annotate(text, (x[-1], y[-1]), xytext=(3, above), textcoords="offset points", fontsize=9)


def _free(left: float, bottom: float, width: float, placed: Sequence[tuple[float, float, float]]) -> bool:
    """Whether a name covers none of those that are there."""
    return all(
        abs(bottom - other) >= LINE or left >= start + wide or start >= left + width for start, other, wide in placed
    )


def alive_paths(truth: pa.Table, role: str) -> dict[str, tuple[Array, Array]]:
    """By the name of each object: ``(points,)`` x and y while it is there, m."""
    rows = rows_where(truth, role=role)
    there = rows.filter(column(rows, "alive") > 0)
    paths = {name: rows_where(there, object=name) for name in names_in_column(rows, "object")}
    return {name: (column(path, "px_m"), column(path, "py_m")) for name, path in paths.items()}


@dataclass(frozen=True)
class _Ground:
    """What is under every panel of a map."""

    roads: pa.Table
    observer: Sequence[tuple[Array, Array]]
    targets: Mapping[str, tuple[Array, Array]]
    left: float
    right: float
    bottom: float
    top: float
    """Edges, m."""

    @property
    def is_stretched(self) -> bool:
        return self.right - self.left > ELONGATED * (self.top - self.bottom)

    @property
    def is_tall(self) -> bool:
        return self.top - self.bottom > self.right - self.left


def _ground(result: Result) -> _Ground | None:
    """The true paths and roads of the recorded run; None without a path."""
    truth = result.tables.truth
    targets, observer = alive_paths(truth, "target"), [*alive_paths(truth, "observer").values()]
    paths = [*targets.values(), *observer]
    x, y = (np.concatenate([path[axis] for path in paths]) if paths else np.empty(0) for axis in (0, 1))
    if not x.size:
        return None
    edges = x.min() - MARGIN_M, x.max() + MARGIN_M, y.min() - MARGIN_M, y.max() + MARGIN_M
    return _Ground(result.tables.roads, observer, targets, *map(float, edges))


def _map(
    ground: _Ground,
    titles: Sequence[str],
    draw: Callable[[Axes, int], None],
    *,
    title: str,
    caption: str,
    alternative: str,
    legend: tuple[LegendEntry, ...],
    tooltips: Mapping[str, str],
) -> Figure:
    """A panel for each title, tall ones beside each other, with what ``draw`` puts on it by its number."""
    rows, columns = (1, len(titles)) if ground.is_tall else (len(titles), 1)
    across, width, depth = WIDTH / columns, ground.right - ground.left, ground.top - ground.bottom
    height = STRETCHED if ground.is_stretched else min(TALLEST, 30 + (across - 50) * depth / width)

    def paint(canvas: Canvas) -> None:
        every = list(canvas.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
        for number, (axes, name) in enumerate(zip(every, titles, strict=True)):
            axes.grid(visible=False)
            points = (across - 50) / width, (height - 30) / depth
            draw_surroundings(axes, ground.roads, ground.observer, ground.targets, points)
            if name:
                panel_title(axes, name, across)
            draw(axes, number)
            axes.set(xlim=(ground.left, ground.right), ylim=(ground.bottom, ground.top), ylabel="y, m")
            if not ground.is_stretched:
                axes.set_aspect("equal")
        every[-1].set_xlabel("x, m")

    stretched = " The axes have different scales." if ground.is_stretched else ""
    total = 30 + rows * height
    return Figure("map", title, caption + stretched, alternative, paint, total, legend=legend, tooltips=tooltips)


def styles_with_map(styles: Sequence[TrackerStyle]) -> list[TrackerStyle]:
    """The trackers that have a map: the best and the last of those given."""
    return list(dict.fromkeys([styles[0], styles[-1]])) if styles else []


def map_of_run(result: Result, styles: Sequence[TrackerStyle], moments: Mapping[str, EstimateMoment]) -> Figure | None:
    """True paths coloured by the error of the best and of the last ranked tracker, a panel each.

    Args:
        result: of the run.
        styles: of the trackers that filter, best first.
        moments: by tracker, the worst; a ring is drawn there.
    """
    drawn, ground, tables = styles_with_map(styles), _ground(result), result.tables
    if ground is None:
        return None
    paths = [
        _paths_with_errors(tables.truth, rows_where(tables.estimates, tracker=style.name), list(ground.targets))
        for style in drawn
    ]
    rings = {style.key: moments[style.name] for style in drawn if style.name in moments}
    limits = error_limits([path[2] for of_tracker in paths for path in of_tracker])

    def draw(axes: Axes, number: int) -> None:
        if not drawn:
            return
        _coloured(axes, paths[number], limits)
        key = drawn[number].key
        if (moment := rings.get(key)) is not None:
            axes.plot(
                *_place(tables.truth, moment), marker="o", markersize=12, markerfacecolor="none",
                markeredgecolor=INK, markeredgewidth=1.4, linestyle="none", gid=f"worst-{key}",
            )  # fmt: skip

    worst = "; ".join(f"{style.name}: {moment_text(rings[style.key])}" for style in drawn if style.key in rings)
    names = joined_names([style.name for style in drawn])
    run = result.summary.recorded_run
    caption = f"Run {run} from above: true paths from the dot to the name; the observer's path is dotted."
    caption += f" Colour and width show the position error of {names}." * bool(drawn)
    caption += f" The ring is where it was largest ({worst})." * bool(worst)
    alternative = f"Map of run {run}: paths of {counted(len(ground.targets), 'vehicle')}"
    levels = (LegendEntry(label, colour) for label, colour in zip(error_labels(limits), ERROR_COLOURS, strict=False))
    return _map(
        ground,
        [style.name for style in drawn] or [""],
        draw,
        title="From above, coloured by position error",
        caption=caption,
        alternative=alternative + (f", coloured by the error of {names}. Largest: {worst}." if drawn else "."),
        legend=(*levels, LegendEntry("observer", MUTED, "dash")),
        tooltips={f"worst-{key}": moment_text(moment) for key, moment in rings.items()},
    )


#: x and y of an object's true path, m, and the error of a tracker along it; NaN where there is no estimate.
_PathWithErrors = tuple[Array, Array, Array]


def _coloured(axes: Axes, tracks: Sequence[_PathWithErrors], limits: Array) -> None:
    """A line for each colour, broken where a path has another; the largest errors on top."""
    x, y, error = (
        np.concatenate([np.append(values, np.nan) for values in of_tracks]) for of_tracks in zip(*tracks, strict=True)
    )
    finite = np.isfinite(error[1:]) & np.isfinite(error[:-1])
    level = np.where(finite, np.digitize(np.fmax(error[1:], error[:-1]), limits), -1)
    for i, colour in enumerate(ERROR_COLOURS[: len(limits) + 1]):
        own = np.flatnonzero(level == i)
        if own.size:
            # Each stretch has one more point than it has segments, and then a gap, as after the last track.
            ends = np.flatnonzero(np.diff(own, append=-1) != 1) + 1
            points = np.insert(own, np.repeat(ends, 2), np.stack([own[ends - 1] + 1, 0 * ends - 1], axis=1).ravel())
            axes.plot(x[points], y[points], color=colour, linewidth=1.8 + 0.7 * i, solid_capstyle="round")


def _paths_with_errors(truth: pa.Table, rows: pa.Table, objects: Sequence[str]) -> list[_PathWithErrors]:
    paths = []
    for name in objects:
        own, path = rows_where(rows, object=name), rows_where(truth, object=name)
        place = np.searchsorted(column(path, "time_s"), column(own, "time_s") - 1e-9)
        if len(place) and place.max() >= len(path):
            raise InputError(f"the estimates of {name} go on after its truth: not the tables of one run")
        paths.append((column(path, "px_m")[place], column(path, "py_m")[place], column(own, "position_error_m")))
    return paths


def _place(truth: pa.Table, moment: EstimateMoment) -> tuple[float, float]:
    """Where the vehicle was."""
    path = rows_where(truth, object=moment.object)
    step = int(np.searchsorted(column(path, "time_s"), moment.time_s - 1e-9))
    return float(column(path, "px_m")[step]), float(column(path, "py_m")[step])


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
        styles: of the trackers that filter, best first.
    """
    run, shown, ground = result.summary.recorded_run, styles_with_map(styles), _ground(result)
    if ground is None or not shown:
        return None
    tracks = [_track_lines(rows_where(result.tables.tracks, tracker=style.name)) for style in shown]
    events = [events_of(result, style.name, run) for style in shown]

    def draw(axes: Axes, number: int) -> None:
        for x, y in tracks[number].values():
            axes.plot(x, y, color=shown[number].colour, linewidth=1.5)
        for kind, (marker, colour, filled) in MARKS.items():
            own = [event for event in events[number] if event.kind == kind]
            axes.plot(
                [event.x_m for event in own], [event.y_m for event in own], marker=marker, markersize=7, color=colour,
                markerfacecolor=filled, markeredgewidth=1.6, linestyle="none", zorder=5,
            )  # fmt: skip

    counts = [f"{style.name} {counted(len(own), 'track')}" for style, own in zip(shown, tracks, strict=True)]
    return _map(
        ground,
        [style.name for style in shown],
        draw,
        title="Tracks from above",
        caption=f"Run {run}, {_which(shown, len(styles))}: true paths in grey from the dot to the name, the observer's "
        "dotted; tracks in the tracker's colour.",
        alternative=f"Map of run {run}: {counted(len(ground.targets), 'vehicle')}; {joined_names(counts)}.",
        legend=(
            LegendEntry("true path", MUTED),
            LegendEntry("switch", INK, "cross"),
            LegendEntry("lost or merged", _LOST, "ring"),
            LegendEntry("false track begins", _FALSE, "triangle"),
        ),
        tooltips={},
    )


def _which(shown: Sequence[TrackerStyle], every: int) -> str:
    """Of the trackers, and where the others are."""
    names = joined_names([style.name for style in shown])
    return names if len(shown) == every else f"the best and the last ranked tracker, {names} (the recording has all)"


def _track_lines(rows: pa.Table) -> Mapping[int, tuple[np.ndarray, np.ndarray]]:
    """``(points,)`` x and y of each track, m."""
    ids, x, y = (column(rows, name) for name in ("track", "px_m", "py_m"))
    return {int(each): (x[ids == each], y[ids == each]) for each in np.unique(ids)}
