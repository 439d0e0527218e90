"""What happened to each object: when it was due, tracked, switched and lost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.errors import counted
from trackbench.document import Figure, LegendEntry, TrackerStyle
from trackbench.document.drawing import GRID, INK, TIME_LABEL, WIDTH, panel_title, time_axis
from trackbench.document.margins import shortened
from trackbench.document.palette import ERROR_COLOURS
from trackbench.report.numbers import joined
from trackbench.report.run.figures.lines import column, names, where

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
    rows = {style.key: where(objects, tracker=style.name) for style in shown}
    due = {name: _due(objects, name) for name in names(objects, "object")}
    vehicles = [name for name, seconds in due.items() if seconds > 0]
    if not shown or not vehicles:
        return None
    longest = sorted(vehicles, key=lambda name: -due[name])[:OBJECTS]
    drawn = [name for name in vehicles if name in longest]
    end = float(column(objects, "until_s").max())

    def paint(canvas: Canvas) -> None:
        panels = canvas.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axes, style in zip(panels, shown, strict=True):
            _panel(axes, rows[style.key], drawn)
            panel_title(axes, style.name, WIDTH)
            time_axis(axes, end)
        panels[-1].set_xlabel(TIME_LABEL)

    left_out = len(vehicles) - len(drawn)
    height = len(shown) * (ROW * len(drawn) + AROUND) + 24
    said = [f"{style.name} {_said(rows[style.key])}" for style in shown]
    return Figure(
        "objects",
        "What happened to each object",
        f"Run {run}, {_which(shown, len(styles))}: a row for each object that was due. No colour: it was not due. An "
        "upright line marks a switch to another track."
        + (f" {counted(left_out, 'object')} that were due for a shorter time are left out." if left_out else ""),
        f"Strips of {counted(len(drawn), 'object')} over time. Share of the due time that is tracked: {joined(said)}.",
        paint,
        height,
        legend=(
            LegendEntry("not yet tracked", _WAITING, "box"),
            LegendEntry("tracked", _TRACKED, "box"),
            LegendEntry("lost", _LOST, "box"),
            LegendEntry("switch", INK, "upright"),
        ),
    )


def _panel(axes: Axes, rows: pa.Table, drawn: Sequence[str]) -> None:
    axes.grid(visible=False)
    for number, name in enumerate(drawn):
        own = where(rows, object=name)
        state, start, until = own["state"].to_pylist(), column(own, "time_s"), column(own, "until_s")
        axes.axhline(number, color=GRID, linewidth=0.6, zorder=0.5)
        for word, colour in COLOURS.items():
            spans = [(a, b - a) for a, b, which in zip(start, until, state, strict=True) if which == word]
            if spans:
                axes.broken_barh(spans, (number - 0.36, 0.72), facecolors=colour)
        switches = [a for a, which in zip(start, state, strict=True) if which == "switched"]
        axes.vlines(switches, number - 0.45, number + 0.45, color=INK, linewidth=1.4)
    axes.set_ylim(len(drawn) - 0.4, -0.6)
    axes.set_yticks(range(len(drawn)), [shortened(name, 70, 8) for name in drawn], fontsize=8)


def _due(objects: pa.Table, name: str) -> float:
    """For how long an object was due, s; that is the same for all trackers."""
    first = names(objects, "tracker")[0]
    return sum(_seconds(where(objects, object=name, tracker=first)).values())


def _seconds(rows: pa.Table) -> Mapping[str, float]:
    spent = column(rows, "until_s") - column(rows, "time_s")
    state = np.array(rows["state"].to_pylist(), dtype=str)
    return {word: float(spent[state == word].sum()) for word in COLOURS}


def _said(rows: pa.Table) -> str:
    seconds = _seconds(rows)
    return f"{100 * (seconds['tracked'] + seconds['switched']) / max(sum(seconds.values()), 1e-9):.1f} %"


def _which(shown: Sequence[TrackerStyle], every: int) -> str:
    if len(shown) == every:
        return counted(every, "tracker") if every > 1 else shown[0].name
    return f"the best {counted(len(shown) - 1, 'tracker')} and the last ranked one"
