"""Figures over time: NEES, NIS and modes, and the lines of all trackers from a result's tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from trackbench.base.errors import counted
from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry, TrackerStyle, end_of_axis
from trackbench.document.drawing import DASHED, INK, MUTED, TIME_LABEL, WIDTH, fit_value_axis, panel_title, time_axis
from trackbench.document.palette import mode_colours, tracker_figure
from trackbench.metrics.consistency import point95
from trackbench.metrics.verdicts import WHITENESS_TOLERANCE
from trackbench.report.numbers import joined_names
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


def panel_grid(canvas: Canvas, titles: Sequence[str], ylabel: str, draw: Callable[[Axes, int], None]) -> Axes:
    """Panels two in a row on the same axes, each drawn by its number and then named; the first of them."""
    columns = 2 if len(titles) > 1 else 1
    rows = -(-len(titles) // columns)
    panels: list[Axes] = list(canvas.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
    for number, (axes, title) in enumerate(zip(panels, titles, strict=False)):
        draw(axes, number)
        panel_title(axes, title, WIDTH / columns)
        axes.set_xlabel(TIME_LABEL if number >= columns * (rows - 1) else "")
        axes.set_ylabel(ylabel if number % columns == 0 else "")
    for axes in panels[len(titles) :]:
        axes.set_visible(False)
    return panels[0]


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


def autocorrelation(table: pa.Table, sensor: str, styles: Sequence[TrackerStyle], number: int) -> Figure | None:
    """Autocorrelation of the whitened innovations of a sensor by lag, with the bounds of white ones."""
    rows = rows_where(table, sensor=sensor)
    lines: list[tuple[TrackerStyle, Array, Array, Array]] = []
    for style in styles:
        own = rows_where(rows, tracker=style.name)
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
            axes.plot(lag, value, **style.look | {"marker": "o", "markevery": None}, markersize=3)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlim(0.5, max(float(lag.max()) for _, lag, _, _ in lines) + 0.5)

    title = f"Autocorrelation of the innovations of {sensor}"
    largest = ", ".join(f"{style.name} {value[np.argmax(abs(value))]:.2f}" for style, _, value, _ in lines)
    shown = [style for style, *_ in lines]
    return tracker_figure(
        f"autocorrelation-{number}",
        title,
        f"Correlation between innovations of {sensor} that are so many measurements apart. If the filter's models "
        "fit, the innovations are white: 95 % of the points are in the grey band. Points above it: the filter follows "
        f"too slowly; below it: it overreacts. Within {WHITENESS_TOLERANCE} of zero it is without consequence.",
        f"{title} at lags of 1 to {int(lines[0][1].max())} measurements. Largest: {largest}.",
        paint,
        220,
        shown,
        LegendEntry("95 % bounds of white innovations", MUTED, "band"),
    )


_MODE_PANEL = 125.0
#: Of the recorded run, for each tracker.
_MOST_OBJECTS = 3


class _ModePanel(NamedTuple):
    title: str
    time: Array
    probability: dict[str, Array]
    """By mode."""


def modes_over_time(result: Result) -> Figure | None:
    """A panel for each tracker that has modes: the mean over runs and objects, and the recorded run."""
    summary = result.summary
    modes, recorded = (result.tables.if_there(name) for name in ("modes", "recorded_modes"))
    objects = names_in_column(recorded, "object")
    panels = []
    for tracker in (each.name for each in result.drawn if each.name in names_in_column(modes, "tracker")):
        if summary.runs > 1:
            panels.append(_mode_panel(rows_where(modes, tracker=tracker), f"{tracker}, {counted(summary.runs, 'run')}"))
        for name in objects[:_MOST_OBJECTS]:
            title = f"{tracker}, run {summary.recorded_run}" + (f", {name}" if len(objects) > 1 else "")
            panels.append(_mode_panel(rows_where(recorded, tracker=tracker, object=name), title))
    return _modes_figure(panels) if panels else None


def _mode_panel(rows: pa.Table, title: str) -> _ModePanel:
    of_mode = {name: rows_where(rows, mode=name) for name in names_in_column(rows, "mode")}
    time = column(next(iter(of_mode.values())), "time_s")
    return _ModePanel(title, time, {name: column(each, "probability") for name, each in of_mode.items()})


def _modes_figure(panels: Sequence[_ModePanel]) -> Figure:
    colours = mode_colours(mode for panel in panels for mode in panel.probability)
    rows = -(-len(panels) // 2)

    def draw(axes: Axes, number: int) -> None:
        panel = panels[number]
        finite = np.isfinite(next(iter(panel.probability.values())))
        below = np.zeros(len(panel.time))
        for mode, probability in panel.probability.items():
            above = below + probability
            axes.fill_between(panel.time, below, above, where=finite, color=colours[mode], linewidth=0, alpha=0.85)
            below = above

    def paint(canvas: Canvas) -> None:
        axes = panel_grid(canvas, [panel.title for panel in panels], "probability", draw)
        time_axis(axes, max(float(panel.time.max()) for panel in panels))
        axes.set_ylim(0, 1)

    return Figure(
        "modes",
        "Modes over time",
        "Which motion model a tracker with several holds for right: the probability of each, one above the other, "
        "together 1. Over several runs it is the mean over them and their objects.",
        f"Probability of each motion model over time, {counted(len(panels), 'panel')}. "
        + " ".join(map(_mean_shares, panels)),
        paint,
        _MODE_PANEL * rows + 60,
        legend=tuple(LegendEntry(mode, colour, "box") for mode, colour in colours.items()),
    )


def _mean_shares(panel: _ModePanel) -> str:
    """The mean over time, for those who cannot see it."""
    shares = [f"{mode} {np.nanmean(rows):.2f}" for mode, rows in panel.probability.items() if np.isfinite(rows).any()]
    return f"{panel.title}: {', '.join(shares) or 'no estimate'} in the mean."
