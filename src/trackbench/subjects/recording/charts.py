"""The entities of a chart: its lines and bounds over simulated time, and their decimal logarithms."""

from __future__ import annotations

import numpy as np

from trackbench.document.replay import Chart
from trackbench.subjects.recording.shapes import send_line
from trackbench.subjects.recording.stream import Stream, path

SERIES = "series"
#: Rerun 0.41 has no logarithmic axis, so what spans orders of magnitude is also there as decimal logarithms.
LOG10 = "log10"


def origin(chart: Chart) -> str:
    """The entity of the values."""
    return path(SERIES, *chart.place)


def log_origin(chart: Chart) -> str:
    """The entity of their decimal logarithms."""
    return path(SERIES, LOG10, *chart.place)


def send_chart(stream: Stream, chart: Chart) -> None:
    """The values, and their logarithms where the range is large."""
    for line in (*chart.lines, *chart.bounds):
        entity = path(SERIES, *chart.place, *line.entity)
        send_line(stream, entity, line.time, line.value, line.name, line.colour, line.width)
        if chart.large:
            logarithm = np.log10(np.where(line.value > 0, line.value, np.nan))
            entity = path(SERIES, LOG10, *chart.place, *line.entity)
            send_line(stream, entity, line.time, logarithm, line.name, line.colour, line.width)
