"""The figure of the autocorrelation of innovations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry, TrackerStyle
from trackbench.document.drawing import MUTED
from trackbench.document.palette import legend_of, tooltips_of
from trackbench.metrics.verdicts import WHITENESS_TOLERANCE
from trackbench.report.run.figures.columns import column, where


def autocorrelation(table: pa.Table, sensor: str, styles: Sequence[TrackerStyle], number: int) -> Figure | None:
    """Autocorrelation of the whitened innovations of a sensor by lag, with the bounds of white ones."""
    rows = where(table, sensor=sensor)
    lines: list[tuple[TrackerStyle, Array, Array, Array]] = []
    for style in styles:
        own = where(rows, tracker=style.name)
        lag = column(own, "lag")
        use = (lag > 0) & np.isfinite(column(own, "correlation"))
        if use.any():
            lines.append((style, lag[use], column(own, "correlation")[use], column(own, "high")[use]))
    if not lines:
        return None

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel="lag, measurements", ylabel="autocorrelation")
        _, lag, _, reach = lines[0]
        axes.fill_between(lag, -reach, reach, color=MUTED, alpha=0.35)
        for style, lag, value, _ in reversed(lines):
            axes.plot(lag, value, color=style.colour, linestyle=style.line, marker="o", markersize=3, gid=style.key)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlim(0.5, max(float(lag.max()) for _, lag, _, _ in lines) + 0.5)

    title = f"Autocorrelation of the innovations of {sensor}"
    largest = ", ".join(f"{style.name} {value[np.argmax(abs(value))]:.2f}" for style, _, value, _ in lines)
    shown = [style for style, *_ in lines]
    return Figure(
        f"autocorrelation-{number}",
        title,
        f"Correlation between innovations of {sensor} that are so many measurements apart. If the filter's models "
        "fit, the innovations are white: 95 % of the points are in the grey band. Points above it: the filter follows "
        f"too slowly; below it: it overreacts. Within {WHITENESS_TOLERANCE} of zero it is without consequence.",
        f"{title} at lags of 1 to {int(lines[0][1].max())} measurements. Largest: {largest}.",
        paint,
        220,
        legend=(*legend_of(shown), LegendEntry("95 % bounds of white innovations", MUTED, "band")),
        tooltips=tooltips_of(shown),
    )
