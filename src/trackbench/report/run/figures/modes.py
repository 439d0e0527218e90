"""The figures of the mode probabilities of trackers with several motion models."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from matplotlib.figure import Figure as Canvas

from trackbench.base.errors import counted
from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import TIME_LABEL, WIDTH, panel_title, time_axis
from trackbench.document.palette import mode_colours
from trackbench.report.run.figures.lines import column, names, where
from trackbench.results import Result

_PANEL = 125.0
#: Of the recorded run, for each tracker.
_MOST_OBJECTS = 3


class _Panel(NamedTuple):
    title: str
    time: Array
    probability: dict[str, Array]
    """By mode."""


def modes_over_time(result: Result) -> Figure | None:
    """A panel for each tracker that has modes: the mean over runs and objects, and the recorded run."""
    summary = result.summary
    modes, recorded = (result.tables.if_there(name) for name in ("modes", "recorded_modes"))
    objects = names(recorded, "object")
    panels = []
    for tracker in (found.name for found in result.drawn if found.name in names(modes, "tracker")):
        if summary.runs > 1:
            panels.append(_panel(where(modes, tracker=tracker), f"{tracker}, {counted(summary.runs, 'run')}"))
        for name in objects[:_MOST_OBJECTS]:
            title = f"{tracker}, run {summary.recorded_run}" + (f", {name}" if len(objects) > 1 else "")
            panels.append(_panel(where(recorded, tracker=tracker, object=name), title))
    return _figure(panels) if panels else None


def _panel(rows: pa.Table, title: str) -> _Panel:
    of_mode = {name: where(rows, mode=name) for name in names(rows, "mode")}
    time = column(next(iter(of_mode.values())), "time_s")
    return _Panel(title, time, {name: column(each, "probability") for name, each in of_mode.items()})


def _figure(panels: Sequence[_Panel]) -> Figure:
    colours = mode_colours(mode for panel in panels for mode in panel.probability)
    columns = 2 if len(panels) > 1 else 1
    rows = -(-len(panels) // columns)

    def paint(canvas: Canvas) -> None:
        every = list(canvas.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
        for number, (axes, panel) in enumerate(zip(every, panels, strict=False)):
            known = np.isfinite(next(iter(panel.probability.values())))
            below = np.zeros(len(panel.time))
            for mode, probability in panel.probability.items():
                above = below + probability
                axes.fill_between(panel.time, below, above, where=known, color=colours[mode], linewidth=0, alpha=0.85)
                below = above
            panel_title(axes, panel.title, WIDTH / columns)
            axes.set_xlabel(TIME_LABEL if number >= columns * (rows - 1) else "")
            axes.set_ylabel("probability" if number % columns == 0 else "")
        for axes in every[len(panels) :]:
            axes.set_visible(False)
        time_axis(every[0], max(float(panel.time.max()) for panel in panels))
        every[0].set_ylim(0, 1)

    return Figure(
        "modes",
        "Modes over time",
        "Which motion model a tracker with several holds for right: the probability of each, one above the other, "
        "together 1. Over several runs it is the mean over them and their objects.",
        f"Probability of each motion model over time, {counted(len(panels), 'panel')}. {' '.join(map(_said, panels))}",
        paint,
        _PANEL * rows + 60,
        legend=tuple(LegendEntry(mode, colour, "box") for mode, colour in colours.items()),
    )


def _said(panel: _Panel) -> str:
    """The mean over time, for those who cannot see it."""
    shares = [f"{mode} {np.nanmean(rows):.2f}" for mode, rows in panel.probability.items() if np.isfinite(rows).any()]
    return f"{panel.title}: {', '.join(shares) or 'no estimate'} in the mean."
