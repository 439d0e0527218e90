"""Figures over time: errors, GOSPA, NEES and NIS, a line for each tracker from a result's tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.errors import counted
from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry, TrackerStyle, end_of_axis
from trackbench.document.drawing import DASHED, INK, MUTED, TIME_LABEL, WIDTH, fit_value_axis, panel_title, time_axis
from trackbench.document.palette import tracker_figure
from trackbench.results import Result


def rows_where(table: pa.Table, **keys: str) -> pa.Table:
    """The rows of ``table`` whose columns equal ``keys``."""
    for name, value in keys.items():
        if name in table.column_names:
            table = table.filter(pc.equal(table[name], value))
    return table


def column(table: pa.Table, name: str) -> Array:
    """A column as floats, NaN where it is null; nothing where the table lacks it."""
    if name not in table.column_names:
        return np.empty(0)
    values: Array = table[name].to_numpy().astype(np.float64)
    return values


def names_in_column(table: pa.Table, name: str) -> list[str]:
    """The different values of a column of text, in the order in which they come."""
    return [] if name not in table.column_names else table[name].unique().to_pylist()


#: Errors are averaged over time to about so many points, or a sensor that alternates with another fills the figure.
_POINTS = 100


class Line(NamedTuple):
    """What is drawn of one tracker."""

    style: TrackerStyle
    time: Array
    """s"""
    value: Array


def lines(table: pa.Table, styles: Sequence[TrackerStyle], name: str) -> list[Line]:
    """The column ``name`` of each tracker that has values in it."""
    drawn = []
    for style in styles:
        rows = rows_where(table, tracker=style.name)
        value = column(rows, name)
        if np.isfinite(value).any():
            drawn.append(Line(style, column(rows, "time_s"), value))
    return drawn


def smooth_lines(table: pa.Table, styles: Sequence[TrackerStyle], name: str) -> list[Line]:
    """The same as root mean squares over equal stretches of time."""
    return [Line(line.style, *_stretches(line.time, line.value)) for line in lines(table, styles, name)]


def beyond_axis(sizes: Mapping[str, float], unit: str) -> tuple[set[str], str]:
    """Which of some trackers are far out, so that the others set the axis, and words for it: "raw beyond the axis: 13.3
    m/s"; neither where none is. ``sizes``: by tracker."""
    end = end_of_axis(sizes.values())
    cut = {name: f"{name} beyond the axis: {size:.3g} {unit}" for name, size in sizes.items() if size > end}
    return {*cut}, "; ".join(cut.values())


def rms_by_name(drawn: Sequence[Line]) -> dict[str, float]:
    """The root mean square of each line."""
    return {line.style.name: float(np.sqrt(np.nanmean(line.value**2))) for line in drawn}


def draw_lines(axes: Axes, drawn: Sequence[Line], end: float) -> None:
    """The best tracker on top, from 0 to ``end`` s."""
    for style, time, value in reversed(drawn):
        axes.plot(time, value, **style.look)
    time_axis(axes, end)


def end_of(table: pa.Table) -> float:
    """The last time of a table, s."""
    return float(column(table, "time_s").max())


def last_values(drawn: Sequence[Line], unit: str) -> str:
    """The last value of each line, for those who cannot see it."""
    last = [(line.style.name, line.value[np.isfinite(line.value)][-1]) for line in drawn]
    return "At the end: " + ", ".join(f"{name} {value:.3g} {unit}".strip() for name, value in last) + "."


def _stretches(time: Array, value: Array) -> tuple[Array, Array]:
    size = max(1, round(len(time) / _POINTS))
    starts = np.arange(0, len(time) - size + 1, size)
    finite = np.isfinite(value)
    count = np.add.reduceat(finite.astype(float), starts)
    square = np.add.reduceat(np.where(finite, value, 0.0) ** 2, starts)
    steps = np.add.reduceat(np.ones(len(time)), starts)
    return np.add.reduceat(time, starts) / steps, np.sqrt(square / np.where(count > 0, count, np.nan))


_HEIGHT = 250.0


def nees_over_time(steps: pa.Table, styles: Sequence[TrackerStyle]) -> Figure | None:
    """Mean NEES over time with its 95 % bounds; None if there is nothing to draw."""
    drawn = lines(steps, styles, "nees_mean")
    if not drawn:
        return None
    shown = [line.style for line in drawn]
    band = [*lines(steps, shown[:1], "nees_low"), *lines(steps, shown[:1], "nees_high")]

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=TIME_LABEL, ylabel="NEES")
        if band:
            low, high = band
            axes.fill_between(low.time, low.value, high.value, color=MUTED, alpha=0.35)
        draw_lines(axes, drawn, end_of(steps))
        if fit_value_axis(axes, [line.value for line in (*drawn, *band)]):
            axes.set_ylabel("NEES, logarithmic")

    return tracker_figure(
        "nees",
        "NEES over time",
        "Squared error over the covariance that the tracker states, averaged over runs and objects. A consistent "
        "tracker is in the grey band 95 % of the time; above it errors are larger than stated, below it smaller.",
        f"NEES over time, {counted(len(drawn), 'tracker')}. {last_values(drawn, '')}",
        paint,
        _HEIGHT,
        shown,
        *([LegendEntry("95 % bounds of a consistent tracker", MUTED, "band")] if band else []),
    )


class Panel(NamedTuple):
    """A quantity over time, and the reference that it is held against."""

    label: str
    unit: str
    column: str
    reference: str = ""
    """Column of the reference; empty without one."""


ERRORS = (
    Panel("position RMSE", "m", "position_rmse_m", "position_reference_m"),
    Panel("velocity RMSE", "m/s", "velocity_rmse_mps", "velocity_reference_mps"),
)
GOSPA_PARTS = (
    Panel("GOSPA", "m", "gospa_m"),
    Panel("localisation", "m", "gospa_localisation_m"),
    Panel("missed", "m", "gospa_missed_m"),
    Panel("false", "m", "gospa_false_m"),
)


def errors_over_time(result: Result, styles: Sequence[TrackerStyle]) -> Figure | None:
    """RMSE of position and velocity over time with those of the reference; None if there is nothing to draw."""
    reference = result.summary.held_against
    caption = f"Root mean square over all runs and objects. Dashed: the {reference.label}. {reference.meaning}"
    return _panels("position-error", "Errors over time", caption, result, styles, ERRORS, reference.label)


def gospa_over_time(result: Result, styles: Sequence[TrackerStyle]) -> Figure | None:
    """GOSPA and its parts over time; None if there is nothing to draw."""
    caption = (
        "Root mean square over all runs. The squares of the parts add up to that of GOSPA: localisation is the "
        "distance of tracks from their objects, missed what objects without a track cost, false what tracks without "
        "an object do."
    )
    return _panels("gospa", "GOSPA over time", caption, result, styles, GOSPA_PARTS)


def _panels(
    name: str,
    title: str,
    caption: str,
    result: Result,
    styles: Sequence[TrackerStyle],
    panels: Sequence[Panel],
    label: str = "",
) -> Figure | None:
    """A panel for each quantity, one below the other; a tracker that is far out does not set an axis."""
    steps = result.tables.steps
    drawn = {panel: own for panel in panels if (own := smooth_lines(steps, styles, panel.column))}
    if not drawn:
        return None
    references = {panel: _distinct(smooth_lines(steps, styles, panel.reference)) for panel in drawn if panel.reference}
    first = next(iter(drawn))

    def paint(canvas: Canvas) -> None:
        every = canvas.subplots(len(drawn), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (panel, own) in zip(every, drawn.items(), strict=True):
            draw_lines(axes, own, end_of(steps))
            for line in references.get(panel, ()):
                axes.plot(line.time, line.value, color=INK, linestyle=DASHED, linewidth=1.3)
            cut, words = beyond_axis(rms_by_name(own), panel.unit)
            near = [line.value for line in (*own, *references.get(panel, ())) if line.style.name not in cut]
            fit_value_axis(axes, near)
            panel_title(axes, words, WIDTH)
            axes.set_ylabel(f"{panel.label}, {panel.unit}")
        every[-1].set_xlabel(TIME_LABEL)

    shown = [line.style for line in drawn[first]]
    return tracker_figure(
        name,
        title,
        caption,
        f"{title}, {counted(len(shown), 'tracker')}. {last_values(drawn[first], first.unit)}",
        paint,
        40 + max(_PANEL, 420.0 / len(drawn) - 40) * len(drawn),
        shown,
        *([LegendEntry(label, INK, "dash")] if any(references.values()) else []),
    )


_PANEL = 120.0


def _distinct(drawn: Sequence[Line]) -> list[Line]:
    """One line of those that are the same: trackers of the same sensors have the same reference."""
    unique: list[Line] = []
    for line in drawn:
        alike = (other for other in unique if other.value.shape == line.value.shape)
        if not any(np.allclose(other.value, line.value, equal_nan=True) for other in alike):
            unique.append(line)
    return unique
