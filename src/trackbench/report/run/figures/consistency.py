"""The figures of NEES and NIS over time, with the bounds of a consistent tracker."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from trackbench.base.errors import counted
from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry, TrackerStyle
from trackbench.document.drawing import DASHED, INK, MUTED, TIME_LABEL, fit_value_axis
from trackbench.document.palette import legend_of, tooltips_of
from trackbench.metrics.consistency import point95
from trackbench.metrics.verdicts import WHITENESS_TOLERANCE
from trackbench.report.numbers import joined
from trackbench.report.run.figures.lines import Line, column, draw_lines, end_of, last_values, lines, styles_of, where

_HEIGHT = 250.0


def nees_over_time(steps: pa.Table, styles: Sequence[TrackerStyle]) -> Figure | None:
    """Mean NEES over time with its 95 % bounds."""
    caption = (
        "Squared error divided by the covariance that the tracker states, averaged over runs and objects. The NEES "
        "of a consistent tracker is in the grey band 95 % of the time. Above it, the errors are larger than stated "
        "(optimistic); below it, smaller (pessimistic)."
    )
    return _with_band("nees", "NEES over time", caption, steps, styles, "nees")


def nis_over_time(nis: pa.Table, sensor: str, styles: Sequence[TrackerStyle], number: int) -> Figure | None:
    """Mean NIS of one sensor over time with its 95 % bounds; of single innovations, with their 95 % point."""
    table = where(nis, sensor=sensor)
    drawn = lines(table, styles, "nis_mean")
    if drawn and np.nanmax(column(table, "count")) <= 1:
        return _single_nis(table, sensor, drawn, number)
    caption = (
        f"Squared innovation of {sensor} (measurement minus prediction) divided by its predicted covariance. Above the "
        "grey band, the measurement noise or the motion is larger than the tracker assumes; below it, smaller."
    )
    return _with_band(f"nis-{number}", f"NIS of {sensor} over time", caption, table, styles, "nis")


def _single_nis(table: pa.Table, sensor: str, drawn: Sequence[Line], number: int) -> Figure:
    limits = {point95(dof): dof for dof in sorted({int(dof) for dof in column(table, "dof")})}
    points = joined([f"{limit:.3f} ({dof} degrees of freedom)" for limit, dof in limits.items()])

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=TIME_LABEL, ylabel="NIS")
        draw_lines(axes, drawn, end_of(table))
        for limit in limits:
            axes.axhline(limit, color=INK, linestyle=DASHED, linewidth=1.3, zorder=3)
        axes.set_ylim(0, 1.06 * max(*limits, *(float(np.nanquantile(line.value, 0.995)) for line in drawn)))

    title = f"NIS of {sensor} over time"
    shown = styles_of(drawn)
    return Figure(
        f"nis-{number}",
        title,
        f"Squared innovation of {sensor} (measurement minus prediction) divided by its predicted covariance, each one "
        f"alone. Of a consistent tracker 95 % are below the dashed line, at {points}. If fewer are, the measurement "
        "noise or the motion is larger than the tracker assumes; if nearly all are, smaller.",
        f"{title}, {counted(len(drawn), 'tracker')}, with the 95 % point of single innovations. "
        f"{last_values(drawn, '')}",
        paint,
        _HEIGHT,
        legend=(*legend_of(shown), LegendEntry("95 % of single innovations", INK, "dash")),
        tooltips=tooltips_of(shown),
    )


def _with_band(
    name: str, title: str, caption: str, table: pa.Table, styles: Sequence[TrackerStyle], metric: str
) -> Figure | None:
    drawn = lines(table, styles, f"{metric}_mean")
    if not drawn:
        return None
    shown = styles_of(drawn)
    band = [*lines(table, shown[:1], f"{metric}_low"), *lines(table, shown[:1], f"{metric}_high")]
    label = metric.upper()

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=TIME_LABEL, ylabel=label)
        if band:
            low, high = band
            axes.fill_between(low.time, low.value, high.value, color=MUTED, alpha=0.35)
        draw_lines(axes, drawn, end_of(table))
        if fit_value_axis(axes, [line.value for line in (*drawn, *band)]):
            axes.set_ylabel(f"{label}, logarithmic")

    key = [LegendEntry("95 % bounds of a consistent tracker", MUTED, "band")] if band else []
    return Figure(
        name,
        title,
        caption,
        f"{title}, {counted(len(drawn), 'tracker')}. {last_values(drawn, '')}",
        paint,
        _HEIGHT,
        legend=(*legend_of(shown), *key),
        tooltips=tooltips_of(shown),
    )


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
