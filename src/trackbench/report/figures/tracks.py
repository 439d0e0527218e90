"""Figures of tracks: GOSPA over time, existence probabilities, and what happened to each object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.errors import counted
from trackbench.document import Figure, LegendEntry, TrackerStyle
from trackbench.document.axes import shortened_to_width
from trackbench.document.drawing import DASHED, GRID, INK, TIME_LABEL, WIDTH, panel_title, time_axis
from trackbench.document.palette import ERROR_COLOURS, tracker_figure
from trackbench.report.figures.over_time import (
    beyond_axis,
    column,
    draw_lines,
    end_of,
    last_values,
    names_in_column,
    rms_by_name,
    rows_where,
    smooth_lines,
    styles_of,
)
from trackbench.report.numbers import joined_names

PARTS = {
    "gospa_m": "GOSPA",
    "gospa_localisation_m": "localisation",
    "gospa_missed_m": "missed",
    "gospa_false_m": "false",
}
_PANEL = 120.0
#: Fewer tracks than these in a bin say too little to be drawn.
FEWEST = 20


def gospa_over_time(steps: pa.Table, styles: Sequence[TrackerStyle]) -> Figure | None:
    """GOSPA and its parts over time, a panel each; None if there is nothing to draw."""
    parts = {name: smooth_lines(steps, styles, name) for name in PARTS}
    shown = styles_of(parts["gospa_m"])
    if not shown:
        return None

    def paint(canvas: Canvas) -> None:
        panels = canvas.subplots(len(parts), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (name, drawn) in zip(panels, parts.items(), strict=True):
            draw_lines(axes, drawn, end_of(steps))
            cut, words = beyond_axis(rms_by_name(drawn), "m")
            near = (line.value for line in drawn if line.style.name not in cut)
            axes.set_ylim(0, 1.06 * max(map(np.nanmax, near), default=0.0) or 1.0)
            panel_title(axes, words, WIDTH)
            axes.set_ylabel(f"{PARTS[name]}, m")
        panels[-1].set_xlabel(TIME_LABEL)

    return tracker_figure(
        "gospa",
        "GOSPA over time",
        "Root mean square over all runs. The squares of the parts add up to that of GOSPA: localisation is the "
        "distance of tracks from their objects, missed what objects without a track cost, false what tracks without an "
        "object cost. The axes differ.",
        f"GOSPA and its parts over time, {counted(len(shown), 'tracker')}. {last_values(parts['gospa_m'], 'm')}",
        paint,
        40 + _PANEL * len(parts),
        shown,
    )


def existence_calibration(existence: pa.Table, styles: Sequence[TrackerStyle]) -> Figure | None:
    """Share of real tracks by the existence probability that they state; None where no tracker states one."""
    drawn = []
    for style in styles:
        rows = rows_where(existence, tracker=style.name)
        enough = column(rows, "count") >= FEWEST
        if enough.any():
            drawn.append((style, column(rows, "stated")[enough], column(rows, "real")[enough]))
    if not drawn:
        return None
    shown = [style for style, _, _ in drawn]

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel="stated existence probability", ylabel="share on an object")
        axes.plot([0, 1], [0, 1], color=INK, linestyle=DASHED, linewidth=1.2)
        for style, stated, real in reversed(drawn):
            axes.plot(stated, real, **style.look | {"marker": style.marker or "o", "markevery": None}, markersize=5)
        axes.set(xlim=(0, 1.03), ylim=(0, 1.05))

    words = [f"{style.name} states {stated[-1]:.2f}, {real[-1]:.2f} are real" for style, stated, real in drawn]
    return tracker_figure(
        "existence",
        "Existence probability",
        "Of the confirmed tracks that state a probability, in ten equal bins, the share that is on an object; on the "
        f"dashed line all is as stated. Bins with fewer than {FEWEST} tracks and instants are left out. Optional "
        "objects and their tracks do not count.",
        f"Stated existence probability against the share of real tracks. In the last bin: {joined_names(words)}.",
        paint,
        240,
        shown,
        LegendEntry("as stated", INK, "dash"),
    )


#: The trackers and the objects that are drawn.
PANELS, OBJECTS = 4, 24
#: Points of a row, and of what is around the rows of a panel.
ROW, AROUND = 11.0, 26.0
_WAITING, _TRACKED, _LOST = ERROR_COLOURS[2], ERROR_COLOURS[0], ERROR_COLOURS[4]
COLOURS = {"waiting": _WAITING, "tracked": _TRACKED, "switched": _TRACKED, "lost": _LOST}


def strip_chart(objects: pa.Table, styles: Sequence[TrackerStyle], run: int) -> Figure | None:
    """A panel for each of the best trackers and the last one, with a row for each object; None where none was due.

    Args:
        objects: what the time of each was spent on in the recorded run.
        styles: of all scored trackers, best first.
        run: number of the recorded run.
    """
    shown = list(dict.fromkeys([*styles[: PANELS - 1], *styles[-1:]]))
    rows = {style.key: rows_where(objects, tracker=style.name) for style in shown}
    due = {name: _due(objects, name) for name in names_in_column(objects, "object")}
    vehicles = [name for name, seconds in due.items() if seconds > 0]
    if not shown or not vehicles:
        return None
    longest = sorted(vehicles, key=lambda name: -due[name])[:OBJECTS]
    drawn = [name for name in vehicles if name in longest]
    end = float(column(objects, "until_s").max())

    def paint(canvas: Canvas) -> None:
        panels = canvas.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axes, style in zip(panels, shown, strict=True):
            _object_rows(axes, rows[style.key], drawn)
            panel_title(axes, style.name, WIDTH)
            time_axis(axes, end)
        panels[-1].set_xlabel(TIME_LABEL)

    left_out = len(vehicles) - len(drawn)
    height = len(shown) * (ROW * len(drawn) + AROUND) + 24
    words = [f"{style.name} {_tracked_share(rows[style.key])}" for style in shown]
    return Figure(
        "objects",
        "What happened to each object",
        f"Run {run}, {_which(shown, len(styles))}: a row for each object that was due. No colour: it was not due. An "
        "upright line marks a switch to another track."
        + (f" {counted(left_out, 'object')} that were due for a shorter time are left out." if left_out else ""),
        f"Strips of {counted(len(drawn), 'object')} over time. Share of the due time that is tracked: "
        f"{joined_names(words)}.",
        paint,
        height,
        legend=(
            LegendEntry("not yet tracked", _WAITING, "box"),
            LegendEntry("tracked", _TRACKED, "box"),
            LegendEntry("lost", _LOST, "box"),
            LegendEntry("switch", INK, "upright"),
        ),
    )


def _object_rows(axes: Axes, rows: pa.Table, drawn: Sequence[str]) -> None:
    axes.grid(visible=False)
    for number, name in enumerate(drawn):
        own = rows_where(rows, object=name)
        state, start, until = own["state"].to_pylist(), column(own, "time_s"), column(own, "until_s")
        axes.axhline(number, color=GRID, linewidth=0.6, zorder=0.5)
        for word, colour in COLOURS.items():
            spans = [(a, b - a) for a, b, which in zip(start, until, state, strict=True) if which == word]
            if spans:
                axes.broken_barh(spans, (number - 0.36, 0.72), facecolors=colour)
        switches = [a for a, which in zip(start, state, strict=True) if which == "switched"]
        axes.vlines(switches, number - 0.45, number + 0.45, color=INK, linewidth=1.4)
    axes.set_ylim(len(drawn) - 0.4, -0.6)
    axes.set_yticks(range(len(drawn)), [shortened_to_width(name, 70, 8) for name in drawn], fontsize=8)


def _due(objects: pa.Table, name: str) -> float:
    """For how long an object was due, s; that is the same for all trackers."""
    first = names_in_column(objects, "tracker")[0]
    return sum(_seconds(rows_where(objects, object=name, tracker=first)).values())


def _seconds(rows: pa.Table) -> Mapping[str, float]:
    spent = column(rows, "until_s") - column(rows, "time_s")
    state = np.array(rows["state"].to_pylist(), dtype=str)
    return {word: float(spent[state == word].sum()) for word in COLOURS}


def _tracked_share(rows: pa.Table) -> str:
    seconds = _seconds(rows)
    return f"{100 * (seconds['tracked'] + seconds['switched']) / max(sum(seconds.values()), 1e-9):.1f} %"


def _which(shown: Sequence[TrackerStyle], every: int) -> str:
    if len(shown) == every:
        return counted(every, "tracker") if every > 1 else shown[0].name
    return f"the best {counted(len(shown) - 1, 'tracker')} and the last ranked one"
