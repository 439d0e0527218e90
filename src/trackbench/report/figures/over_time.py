"""Figures over time: errors, GOSPA, NEES and NIS, a line for each tracker from a result's tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, NamedTuple

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
from trackbench.metrics.consistency import point95
from trackbench.report.numbers import joined_names
from trackbench.results.scenario_summary import ReferenceSummary


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


def styles_of(drawn: Iterable[Line]) -> list[TrackerStyle]:
    """Whose lines they are."""
    return [line.style for line in drawn]


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
    """Mean NEES over time with its 95 % bounds."""
    caption = (
        "Squared error divided by the covariance that the tracker states, averaged over runs and objects. The NEES "
        "of a consistent tracker is in the grey band 95 % of the time. Above it, the errors are larger than stated "
        "(optimistic); below it, smaller (pessimistic)."
    )
    return _with_band("nees", "NEES over time", caption, steps, styles, "nees")


def nis_over_time(nis: pa.Table, sensor: str, styles: Sequence[TrackerStyle], number: int) -> Figure | None:
    """Mean NIS of one sensor over time with its 95 % bounds; of single innovations, with their 95 % point."""
    table = rows_where(nis, sensor=sensor)
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
    points = joined_names([f"{limit:.3f} ({dof} degrees of freedom)" for limit, dof in limits.items()])

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=TIME_LABEL, ylabel="NIS")
        draw_lines(axes, drawn, end_of(table))
        for limit in limits:
            axes.axhline(limit, color=INK, linestyle=DASHED, linewidth=1.3, zorder=3)
        axes.set_ylim(0, 1.06 * max(*limits, *(float(np.nanquantile(line.value, 0.995)) for line in drawn)))

    title = f"NIS of {sensor} over time"
    shown = styles_of(drawn)
    return tracker_figure(
        f"nis-{number}",
        title,
        f"Squared innovation of {sensor} (measurement minus prediction) divided by its predicted covariance, each one "
        f"alone. Of a consistent tracker 95 % are below the dashed line, at {points}. If fewer are, the measurement "
        "noise or the motion is larger than the tracker assumes; if nearly all are, smaller.",
        f"{title}, {counted(len(drawn), 'tracker')}, with the 95 % point of single innovations. "
        f"{last_values(drawn, '')}",
        paint,
        _HEIGHT,
        shown,
        LegendEntry("95 % of single innovations", INK, "dash"),
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
    return tracker_figure(
        name,
        title,
        caption,
        f"{title}, {counted(len(drawn), 'tracker')}. {last_values(drawn, '')}",
        paint,
        _HEIGHT,
        shown,
        *key,
    )


Quantity = Literal["position", "velocity"]
QUANTITIES: tuple[Quantity, ...] = ("position", "velocity")
_UNITS: dict[Quantity, str] = {"position": "m", "velocity": "m/s"}


def error_over_time(
    steps: pa.Table, styles: Sequence[TrackerStyle], quantity: Quantity, reference: ReferenceSummary
) -> Figure | None:
    """RMSE of a quantity over time with that of the reference; None if there is nothing to draw."""
    unit = _UNITS[quantity]
    suffix = unit.replace("/", "p")
    drawn = smooth_lines(steps, styles, f"{quantity}_rmse_{suffix}")
    references = _distinct(smooth_lines(steps, styles, f"{quantity}_reference_{suffix}"))
    if not drawn:
        return None
    cut, words = beyond_axis(rms_by_name(drawn), unit)

    def colour(group: Sequence[Line]) -> str:
        return INK if len(references) == 1 else group[0].style.colour

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=TIME_LABEL, ylabel=f"{quantity} RMSE, {unit}")
        draw_lines(axes, drawn, end_of(steps))
        for group in references:
            axes.plot(group[0].time, group[0].value, color=colour(group), linestyle=DASHED, linewidth=1.3)
        near = [line.value for line in (*drawn, *(group[0] for group in references)) if line.style.name not in cut]
        fit_value_axis(axes, near)
        panel_title(axes, words, WIDTH)

    caption = f"RMSE of the {quantity} over all runs and objects, {_window(drawn)}.{_sentence(words)}"
    if references:
        caption += f" Dashed: the {reference.label}. {reference.meaning}"
    shown = styles_of(drawn)
    keys = [LegendEntry(_label(reference, group, len(references)), colour(group), "dash") for group in references]
    return tracker_figure(
        f"{quantity}-error",
        f"{quantity.capitalize()} error over time",
        caption,
        f"RMSE of {quantity} over time, {counted(len(drawn), 'tracker')}. {last_values(drawn, unit)}",
        paint,
        _HEIGHT,
        shown,
        *keys,
    )


def _sentence(words: str) -> str:
    """What goes beyond an axis, after another sentence."""
    return f" {words}." if words else ""


def _window(drawn: Sequence[Line]) -> str:
    return f"averaged over {np.diff(drawn[0].time[:2]).sum():.2g} s"


def _distinct(drawn: Sequence[Line]) -> list[list[Line]]:
    """Lines grouped by what they show: trackers of the same sensors have the same reference."""
    groups: list[list[Line]] = []
    for line in drawn:
        for group in groups:
            other = group[0]
            if other.value.shape == line.value.shape and np.allclose(other.value, line.value, equal_nan=True):
                group.append(line)
                break
        else:
            groups.append([line])
    return groups


def _label(reference: ReferenceSummary, group: Sequence[Line], groups: int) -> str:
    return (
        reference.label if groups == 1 else f"{reference.label} of {joined_names([line.style.name for line in group])}"
    )


_PARTS = {
    "gospa_m": "GOSPA",
    "gospa_localisation_m": "localisation",
    "gospa_missed_m": "missed",
    "gospa_false_m": "false",
}
_PANEL = 120.0


def gospa_over_time(steps: pa.Table, styles: Sequence[TrackerStyle]) -> Figure | None:
    """GOSPA and its parts over time, a panel each; None if there is nothing to draw."""
    parts = {name: smooth_lines(steps, styles, name) for name in _PARTS}
    shown = styles_of(parts["gospa_m"])
    if not shown:
        return None

    def paint(canvas: Canvas) -> None:
        panels = canvas.subplots(len(parts), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (name, drawn) in zip(panels, parts.items(), strict=True):
            draw_lines(axes, drawn, end_of(steps))
            cut, words = beyond_axis(rms_by_name(drawn), "m")
            near = (line.value for line in drawn if line.style.name not in cut)
            axes.set_ylim(0, 1.06 * max(map(np.nanmax, near), default=0.0) or 1.0)
            panel_title(axes, words, WIDTH)
            axes.set_ylabel(f"{_PARTS[name]}, m")
        panels[-1].set_xlabel(TIME_LABEL)

    return tracker_figure(
        "gospa",
        "GOSPA over time",
        "Root mean square over all runs. The squares of the parts add up to that of GOSPA: localisation is the "
        "distance of tracks from their objects, missed what objects without a track cost, false what tracks without an "
        "object cost. The axes differ.",
        f"GOSPA and its parts over time, {counted(len(shown), 'tracker')}. {last_values(parts['gospa_m'], 'm')}",
        paint,
        40 + _PANEL * len(parts),
        shown,
    )
