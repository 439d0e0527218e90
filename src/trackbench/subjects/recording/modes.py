"""The charts of the mode probabilities of trackers with several motion models."""

from __future__ import annotations

from collections.abc import Iterable

import pyarrow as pa

from trackbench.document.palette import mode_colours
from trackbench.document.replay import Chart, ChartLine
from trackbench.results.columns import mean_over_objects, split

MODES = "modes"


def mode_charts(place: tuple[str, ...], modes: pa.Table, trackers: Iterable[str]) -> tuple[Chart, ...]:
    """A chart for each tracker that has modes, with a line for each: the mean over the vehicles of the table.

    Args:
        place: the entity of the charts, below that of all series.
        modes: over all runs or of the recorded one.
        trackers: those that are drawn.
    """
    of = split(modes, "tracker", "mode")
    colours = mode_colours(mode for _, mode in of)
    lines: dict[str, list[ChartLine]] = {}
    for (tracker, mode), rows in of.items():
        time, mean, _ = mean_over_objects(rows["time_s"], rows["probability"])
        lines.setdefault(tracker, []).append(ChartLine((mode,), mode, colours[mode], time, mean))
    return tuple(
        Chart((*place, MODES, tracker), f"Modes of {tracker}", "", tuple(lines[tracker]), share=True)
        for tracker in trackers
        if tracker in lines
    )
