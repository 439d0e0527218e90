"""The figure of the autocorrelation of innovations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from trackbench.report.columns import column, where
from trackbench.report.figures import Entry, Look, Picture, entries, titles
from trackbench.report.svg import MUTED, draw, in_page
from trackbench.types import Array


def autocorrelation(table: pa.Table, sensor: str, shown: Sequence[Look], number: int) -> Picture | None:
    """Autocorrelation of the whitened innovations of a sensor by lag, with the bounds of white ones."""
    rows = where(table, sensor=sensor)
    lines: list[tuple[Look, Array, Array, Array]] = []
    for look in shown:
        own = where(rows, tracker=look.name)
        lag = column(own, "lag")
        use = (lag > 0) & np.isfinite(column(own, "correlation"))
        if use.any():
            lines.append((look, lag[use], column(own, "correlation")[use], column(own, "high")[use]))
    if not lines:
        return None

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel="lag, measurements", ylabel="autocorrelation")
        _, lag, _, reach = lines[0]
        axes.fill_between(lag, -reach, reach, color=MUTED, alpha=0.35)
        for look, lag, value, _ in reversed(lines):
            axes.plot(lag, value, color=look.colour, linestyle=look.style, marker="o", markersize=3, gid=look.key)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlim(0.5, max(float(lag.max()) for _, lag, _, _ in lines) + 0.5)

    name, title = f"autocorrelation-{number}", f"Autocorrelation of the innovations of {sensor}"
    largest = ", ".join(f"{look.name} {value[np.argmax(abs(value))]:.2f}" for look, _, value, _ in lines)
    alternative = f"{title} at lags of 1 to {int(lines[0][1].max())} measurements. Largest: {largest}."
    caption = (
        f"How much a surprise of {sensor} foretells the one so many measurements later. A filter whose models fit "
        "leaves nothing to foretell: 95 % of its points are in the grey band. Points above it: the filter follows too "
        "slowly, and errors last; below it: it overreacts."
    )
    svg = in_page(draw(paint, 220), name, alternative, titles(look for look, *_ in lines))
    key = Entry("95 % bounds of white innovations", "var(--muted)", "band")
    return Picture(name, title, caption, alternative, svg, (*entries(look for look, *_ in lines), key))
