"""GOSPA over time with its parts, and how far a stated existence probability is right."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
from matplotlib.figure import Figure as Canvas

from trackbench.base.errors import counted
from trackbench.document import Figure, LegendEntry, TrackerStyle
from trackbench.document.drawing import DASHED, INK, TIME_LABEL, WIDTH, panel_title
from trackbench.document.palette import legend_of, tooltips_of
from trackbench.report.numbers import joined
from trackbench.report.run.figures.lines import column, draw_lines, end_of, last_values, smooth_lines, styles_of, where

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
            highest = max((float(np.nanmax(line.value)) for line in drawn), default=0.0)
            axes.set_ylim(0, 1.06 * highest or 1.0)
            axes.set_ylabel("m")
            panel_title(axes, PARTS[name], WIDTH)
        panels[-1].set_xlabel(TIME_LABEL)

    return Figure(
        "gospa",
        "GOSPA over time",
        "Root mean square over all runs. The squares of the parts add up to that of GOSPA: localisation is the "
        "distance of tracks from their objects, missed what objects without a track cost, false what tracks without an "
        "object cost. The axes differ.",
        f"GOSPA and its parts over time, {counted(len(shown), 'tracker')}. {last_values(parts['gospa_m'], 'm')}",
        paint,
        40 + _PANEL * len(parts),
        legend=legend_of(shown),
        tooltips=tooltips_of(shown),
    )


def existence_calibration(existence: pa.Table, styles: Sequence[TrackerStyle]) -> Figure | None:
    """Share of real tracks by the existence probability that they state; None where no tracker states one."""
    drawn = []
    for style in styles:
        rows = where(existence, tracker=style.name)
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
            axes.plot(stated, real, color=style.colour, linestyle=style.line, marker="o", markersize=5, gid=style.key)
        axes.set(xlim=(0, 1.03), ylim=(0, 1.05))

    said = [f"{style.name} states {stated[-1]:.2f}, {real[-1]:.2f} are real" for style, stated, real in drawn]
    return Figure(
        "existence",
        "Existence probability",
        "Of the confirmed tracks that state a probability, in ten equal bins, the share that is on an object; on the "
        f"dashed line all is as stated. Bins with fewer than {FEWEST} tracks and instants are left out. Optional "
        "objects and their tracks do not count.",
        f"Stated existence probability against the share of real tracks. In the last bin: {joined(said)}.",
        paint,
        240,
        legend=(*legend_of(shown), LegendEntry("as stated", INK, "dash")),
        tooltips=tooltips_of(shown),
    )
