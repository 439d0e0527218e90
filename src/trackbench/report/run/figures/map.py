"""The map of the recorded run, coloured by the position error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.errors import InputError, counted
from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry, TrackerStyle
from trackbench.document.drawing import INK, MUTED, WIDTH, panel_title
from trackbench.document.palette import ERROR_COLOURS
from trackbench.metrics.moments import EstimateMoment
from trackbench.report.numbers import fixed
from trackbench.report.run.figures.ground import alive_path, box_around, draw_surroundings
from trackbench.report.run.figures.lines import column, names, where
from trackbench.report.run.moments import say
from trackbench.results import Tables

#: Round numbers among which the limits of the colours are chosen, m.
_ROUND = np.array([step * 10.0**power for power in range(-3, 4) for step in (1, 2, 5)])


@dataclass(frozen=True)
class _Track:
    """One object's true path, with the error of a tracker along it; NaN where there is no estimate."""

    x: Array
    y: Array
    error: Array


def mapped(styles: Sequence[TrackerStyle]) -> list[TrackerStyle]:
    """The trackers that have a map: the best and the last ranked."""
    return list(dict.fromkeys([styles[0], styles[-1]])) if styles else []


def map_of_run(
    tables: Tables, run: int, styles: Sequence[TrackerStyle], moments: Mapping[str, EstimateMoment]
) -> Figure | None:
    """True paths coloured by the error of the best and of the last ranked tracker, a panel each.

    Args:
        tables: of the run.
        run: number of the recorded run.
        styles: of all scored trackers, best first.
        moments: by tracker, the worst; a ring is drawn there.
    """
    truth = tables.truth
    drawn = mapped(styles)
    targets = {name: alive_path(truth, name) for name in names(where(truth, role="target"), "object")}
    observer = [alive_path(truth, name) for name in names(where(truth, role="observer"), "object")]
    box = box_around([*targets.values(), *observer])
    if box is None:
        return None
    estimates = [where(tables.estimates, tracker=style.name) for style in drawn]
    tracks = [_tracks(truth, rows, list(targets)) for rows in estimates]
    rings = {style.key: moments[style.name] for style in drawn if style.name in moments}
    roads = tables.roads
    limits = _limits([track.error for of in tracks for track in of])
    panels = max(1, len(drawn))
    beside = box.height > box.width

    def paint(canvas: Canvas) -> None:
        rows, columns = (1, panels) if beside else (panels, 1)
        every = list(canvas.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
        for i, axes in enumerate(every):
            axes.grid(visible=False)
            draw_surroundings(axes, roads, observer, targets, box.points(across))
            if drawn:
                panel_title(axes, drawn[i].name, across)
                _coloured(axes, tracks[i], limits)
                if (moment := rings.get(drawn[i].key)) is not None:
                    axes.plot(
                        *_place(truth, moment), marker="o", markersize=12, markerfacecolor="none",
                        markeredgecolor=INK, markeredgewidth=1.4, linestyle="none", gid=f"worst-{drawn[i].key}",
                    )  # fmt: skip
            axes.set(xlim=(box.left, box.right), ylim=(box.bottom, box.top), ylabel="y, m")
            if not box.stretched:
                axes.set_aspect("equal")
        every[-1].set_xlabel("x, m")

    across = WIDTH / panels if beside else WIDTH
    height = box.drawn_height(across)
    worst = "; ".join(f"{style.name}: {say(rings[style.key])}" for style in drawn if style.key in rings)
    alternative = (
        f"Map of run {run}: paths of {counted(len(targets), 'vehicle')} over "
        f"{fixed(box.width, 0)} m by {fixed(box.height, 0)} m"
        + (f", coloured by the error of {' and of '.join(style.name for style in drawn)}" if drawn else "")
        + (f". Largest errors: {worst}." if worst else ".")
    )
    caption = f"Run {run} from above: true paths from the dot to the name; the observer's path is dotted. "
    if drawn:
        caption += (
            "Colour and width show the position error of the best"
            + (" and of the last ranked tracker" if len(drawn) > 1 else " tracker")
            + "."
        )
        caption += f" The ring is where it was largest ({worst}). " if worst else " "
        caption += "The recording shows all trackers. "
    if box.stretched:
        caption += "The axes have different scales."
    return Figure(
        "map",
        "From above, coloured by position error",
        caption.strip(),
        alternative,
        paint,
        30 + (height if beside else panels * height),
        legend=_legend(limits),
        tooltips={f"worst-{key}": say(moment) for key, moment in rings.items()},
    )


def _coloured(axes: Axes, tracks: Sequence[_Track], limits: Array) -> None:
    """A line for each colour, broken where a path has another; the largest errors on top."""
    x, y, error = (
        np.concatenate([np.append(getattr(track, name), np.nan) for track in tracks]) for name in ("x", "y", "error")
    )
    known = np.isfinite(error[1:]) & np.isfinite(error[:-1])
    level = np.where(known, np.digitize(np.fmax(error[1:], error[:-1]), limits), -1)
    for i, colour in enumerate(ERROR_COLOURS[: len(limits) + 1]):
        own = np.flatnonzero(level == i)
        if own.size:
            # Each stretch has one more point than it has segments, and then a gap, as after the last track.
            ends = np.flatnonzero(np.diff(own, append=-1) != 1) + 1
            points = np.insert(own, np.repeat(ends, 2), np.stack([own[ends - 1] + 1, 0 * ends - 1], axis=1).ravel())
            axes.plot(x[points], y[points], color=colour, linewidth=1.8 + 0.7 * i, solid_capstyle="round")


def _limits(errors: Sequence[Array]) -> Array:
    """Round limits between the colours that spread the errors over them, m."""
    every = np.concatenate(errors) if errors else np.empty(0)
    every = every[np.isfinite(every)]
    if not every.size:
        return np.empty(0)
    low, high = np.quantile(every, [0.25, 0.98])
    inside = _ROUND[(low <= _ROUND) & (high >= _ROUND)]
    if len(inside) < 2:
        nearest = int(np.argmin(abs(_ROUND - high)))
        inside = _ROUND[max(0, nearest - 1) : nearest + 1]
    most = len(ERROR_COLOURS) - 1
    return np.asarray(inside[np.unique(np.linspace(0, len(inside) - 1, most).round().astype(int))])


def _legend(limits: Array) -> tuple[LegendEntry, ...]:
    said = [f"{limit:g}" for limit in limits]
    labels = (
        [f"under {said[0]} m", *(f"{a} to {b} m" for a, b in pairwise(said)), f"above {said[-1]} m"] if said else []
    )
    return (
        *(LegendEntry(label, colour) for label, colour in zip(labels, ERROR_COLOURS, strict=False)),
        LegendEntry("observer", MUTED, "dash"),
    )


def _tracks(truth: pa.Table, rows: pa.Table, objects: Sequence[str]) -> list[_Track]:
    found = []
    for name in objects:
        own, path = where(rows, object=name), where(truth, object=name)
        place = np.searchsorted(column(path, "time_s"), column(own, "time_s") - 1e-9)
        if len(place) and place.max() >= len(path):
            raise InputError(f"the estimates of {name} go on after its truth: not the tables of one run")
        found.append(_Track(column(path, "px_m")[place], column(path, "py_m")[place], column(own, "position_error_m")))
    return found


def _place(truth: pa.Table, moment: EstimateMoment) -> tuple[float, float]:
    """Where the vehicle was."""
    path = where(truth, object=moment.object)
    step = int(np.searchsorted(column(path, "time_s"), moment.time_s - 1e-9))
    return float(column(path, "px_m")[step]), float(column(path, "py_m")[step])
