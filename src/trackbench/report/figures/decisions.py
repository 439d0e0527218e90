"""A strip of what a function decides in the recorded run, on the truth and on the tracks of each tracker."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry, TrackerStyle
from trackbench.document.drawing import DASHED, GRID, INK, MUTED, TIME_LABEL, time_axis
from trackbench.document.margins import shortened_to_width
from trackbench.metrics.function_events import FunctionEvent
from trackbench.report.figures.over_time import column, rows_where
from trackbench.report.numbers import joined_names, rounded

#: Points of a row, and of what is around the rows.
ROW, AROUND = 20.0, 44.0
#: Half the height of a bar, and of what is late or missed.
BAR, LATE = 0.34, 0.12


def strip_of_decisions(
    decisions: pa.Table, events: Sequence[FunctionEvent], function: str, styles: Sequence[TrackerStyle], run: int
) -> Figure | None:
    """A row for the truth and one for each tracker; None where the recorded run has nothing to draw.

    Args:
        decisions: of the recorded run.
        events: of the function in the recorded run, of every tracker.
        function: its name.
        styles: of the trackers, best first.
        run: number of the recorded run.
    """
    rows = {style.name: rows_where(decisions, tracker=style.name, function=function) for style in styles}
    shown = [style for style in styles if rows[style.name].num_rows]
    if not any(column(rows[style.name], name).any() for style in shown for name in ("active", "true_active")):
        return None
    first = rows[shown[0].name]
    time, hit = column(first, "time_s"), np.flatnonzero(column(first, "impact"))
    truth = active_spans(time, column(first, "true_active"))

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=TIME_LABEL)
        axes.grid(visible=False)
        axes.broken_barh([(a, b - a) for a, b in truth], (-BAR, 2 * BAR), facecolors=INK)
        axes.vlines([a for a, _ in truth], -BAR, len(shown) + 0.5, color=MUTED, linestyle=DASHED, linewidth=0.8)
        for number, style in enumerate(shown, start=1):
            axes.axhline(number, color=GRID, linewidth=0.6, zorder=0.5)
            bars = active_spans(time, column(rows[style.name], "active"))
            axes.broken_barh([(a, b - a) for a, b in bars], (number - BAR, 2 * BAR), facecolors=style.colour)
            _draw_events(axes, number, [event for event in events if event.tracker == style.name])
        axes.vlines(time[hit[:1]], -0.5, len(shown) + 0.5, color=INK, linewidth=2)
        axes.set_ylim(len(shown) + 0.6, -0.6)
        labels = ["truth", *(shortened_to_width(style.name, 90, 9) for style in shown)]
        axes.set_yticks(range(len(labels)), labels, fontsize=9)
        time_axis(axes, float(time[-1]))

    impact = f" An object touches the ego from {rounded(time[hit[0]], 2)} s on." if len(hit) else ""
    return Figure(
        f"decisions-{function}",
        f"Decisions of {function}",
        f"Run {run}. A bar is a time in which it is active. Below the truth, on the tracks of each tracker: a thin bar "
        "is the time by which it is late, a cross a missed event, a triangle activity without an event.",
        f"Active on the truth {_in_words(truth)}.{impact} {_said(shown, events)}",
        paint,
        ROW * (len(shown) + 1) + AROUND,
        legend=(
            LegendEntry("active", INK, "box"),
            LegendEntry("late", INK, "line"),
            LegendEntry("missed", INK, "cross"),
            LegendEntry("false", INK, "triangle"),
            *([LegendEntry("impact", INK, "upright")] if len(hit) else []),
        ),
    )


def active_spans(time: Array, active: Array) -> list[tuple[float, float]]:
    """The first and the last instant (s) of each activity; up to the next one where it is a single one."""
    change = np.diff(np.concatenate([[0.0], active, [0.0]]))
    ends = np.append(time, time[-1])
    return list(zip(time[np.flatnonzero(change > 0)].tolist(), ends[np.flatnonzero(change < 0)].tolist(), strict=True))


def _draw_events(axes: Axes, row: int, events: Iterable[FunctionEvent]) -> None:
    for event in events:
        start, until, word = event.time_s, event.until_s, event.word
        if word in ("late", "missed"):
            axes.broken_barh([(start, event.wrong_s)], (row - LATE, 2 * LATE), facecolors=INK)
        if word == "missed":
            axes.plot((start + until) / 2, row, color=INK, marker="x", markersize=9, markeredgewidth=2)
        if word == "false":
            axes.plot((start + until) / 2, row, color=INK, marker="^", markersize=8)


def _in_words(spans: Sequence[tuple[float, float]]) -> str:
    if not spans:
        return "never"
    return joined_names([f"from {rounded(start, 2)} s to {rounded(stop, 2)} s" for start, stop in spans])


def _said(shown: Sequence[TrackerStyle], events: Sequence[FunctionEvent]) -> str:
    """What was wrong of each tracker."""
    sentences = []
    for style in shown:
        own = [f"{event.word} by {rounded(event.wrong_s, 2)} s" for event in events if event.tracker == style.name]
        sentences.append(f"{style.name}: {', '.join(own) or 'nothing wrong'}.")
    return " ".join(sentences)
