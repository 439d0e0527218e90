"""The figures over time: errors with the bound and the spread of the runs, NEES and NIS with their bounds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from trackbench.metrics.consistency import point95
from trackbench.report.columns import column, where
from trackbench.report.figures import Entry, Look, Picture, entries, fit_value_axis, titles
from trackbench.report.numbers import joined
from trackbench.report.svg import GRID, INK, MUTED, draw, in_page
from trackbench.types import Array
from trackbench.words import counted

_HEIGHT = 250.0
_PANEL = 125.0
_TIME = "time, s"
_DASHED = (0, (4, 2))
#: Errors are averaged over time to about so many points, or a sensor that alternates with another fills the figure.
_POINTS = 100


class _Line(NamedTuple):
    look: Look
    time: Array
    value: Array


def error_over_time(
    steps: pa.Table, shown: Sequence[Look], quantity: str, unit: str, acceleration: float | None
) -> Picture | None:
    """RMSE of ``quantity`` ("position" or "velocity") over time with its bound; None if there is nothing to draw.

    ``acceleration`` (m/s^2) is the standard deviation that the bound assumes.
    """
    suffix = unit.replace("/", "p")
    lines = _smooth(_lines(steps, shown, f"{quantity}_rmse_{suffix}"))
    bounds = _distinct(_smooth(_lines(steps, shown, f"{quantity}_bound_{suffix}")))
    if not lines:
        return None

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel=_TIME, ylabel=f"{quantity} RMSE, {unit}")
        _draw(axes, steps, lines)
        for group in bounds:
            colour = INK if len(bounds) == 1 else group[0].look.colour
            axes.plot(group[0].time, group[0].value, color=colour, linestyle=_DASHED, linewidth=1.3)
        fit_value_axis(axes, [line.value for line in lines] + [group[0].value for group in bounds])

    name = f"{quantity}-error"
    alternative = f"RMSE of {quantity} over time, {_shown(lines)}. {_ends(lines, unit)}"
    keys = [
        Entry(_bound_label(group, len(bounds)), "currentColor" if len(bounds) == 1 else group[0].look.colour, "dash")
        for group in bounds
    ]
    caption = f"RMSE of the {quantity} over all runs and objects, {_window(lines)}; lower is better."
    if bounds:
        caption += " The distance to the dashed Cramér-Rao bound is what a better tracker could still gain."
    if bounds and acceleration is not None:
        caption += (
            f" The bound assumes random accelerations of {acceleration:.2g} m/s²; a tracker can be below it while the "
            "vehicles move more smoothly than that."
        )
    svg = in_page(draw(paint, _HEIGHT), name, alternative, titles(line.look for line in lines))
    return Picture(
        name,
        f"{quantity.capitalize()} error over time",
        caption,
        alternative,
        svg,
        (*entries(n.look for n in lines), *keys),
    )


def spread(steps: pa.Table, shown: Sequence[Look]) -> Picture | None:
    """A panel per tracker: its position RMSE within the spread of the runs, and the bound."""
    lines = _smooth(_lines(steps, shown, "position_rmse_m"))
    low = {line.look.key: line.value for line in _smooth(_lines(steps, shown, "position_p10_m"))}
    high = {line.look.key: line.value for line in _smooth(_lines(steps, shown, "position_p90_m"))}
    bounds = {line.look.key: line for line in _smooth(_lines(steps, shown, "position_bound_m"))}
    # One object in one run has no spread.
    if not lines or all(key in high and np.array_equal(low[key], high[key], equal_nan=True) for key in low):
        return None
    columns = 2 if len(lines) > 1 else 1
    rows = -(-len(lines) // columns)

    def paint(figure: Figure) -> None:
        grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        panels = list(grid.flat)
        for axes, line in zip(panels, lines, strict=False):
            key = line.look.key
            if key in low and key in high:
                axes.fill_between(line.time, low[key], high[key], color=line.look.colour, alpha=0.3)
            axes.plot(line.time, line.value, color=line.look.colour)
            if key in bounds:
                axes.plot(bounds[key].time, bounds[key].value, color=INK, linestyle=_DASHED, linewidth=1.2)
            axes.set_title(line.look.name, fontsize=10, loc="left", pad=2)
        for axes in panels[len(lines) :]:
            axes.set_visible(False)
        _time_axis(panels[0], steps)
        fit_value_axis(panels[0], [*high.values(), *low.values(), *(line.value for line in lines)])
        figure.supxlabel(_TIME)
        figure.supylabel("position error, m")

    name = "position-spread"
    alternative = f"Position error over time with the spread of the runs, one panel for each of {_shown(lines)}."
    caption = (
        "One panel per tracker, on the same axes: the line is the RMSE, the band holds the middle 80 % of the errors "
        f"of single runs and objects (10th to 90th percentile), {_window(lines)}; dashed is the Cramér-Rao bound. A "
        "line above its band means that a few runs are far worse than the rest."
    )
    svg = in_page(draw(paint, max(_HEIGHT, 40 + _PANEL * rows)), name, alternative, {})
    legend = (
        Entry("RMSE", "var(--muted)"),
        Entry("10th to 90th percentile", "var(--muted)", "band"),
        *([Entry("Cramér-Rao bound", "currentColor", "dash")] if bounds else []),
    )
    return Picture(name, "InitialSigmas of the runs", caption, alternative, svg, legend)


def nees_over_time(steps: pa.Table, shown: Sequence[Look]) -> Picture | None:
    """Mean NEES over time with its 95 % bounds."""
    lines = _lines(steps, shown, "nees_mean")
    caption = (
        "Squared error in units of the covariance that the tracker itself claims, averaged over runs and objects. A "
        "tracker that knows its own accuracy stays in the grey band 95 % of the time. Above it the tracker is "
        "optimistic: its errors are larger than it claims. Below it, it is pessimistic."
    )
    return _with_band("nees", "NEES over time", caption, "NEES", steps, lines, "nees")


def nis_over_time(nis: pa.Table, sensor: str, shown: Sequence[Look], number: int) -> Picture | None:
    """Mean NIS of one sensor over time with its 95 % bounds; of single innovations, with their 95 % line."""
    table = where(nis, sensor=sensor)
    lines = _lines(table, shown, "nis_mean")
    if lines and np.nanmax(column(table, "count")) <= 1:
        return _single_nis(table, sensor, lines, number)
    caption = (
        f"Squared innovation of {sensor} (measurement minus prediction) in units of its predicted covariance. In the "
        "grey band, predictions and measurements agree as well as the tracker says they do; above it, the noise or the "
        "motion is larger than the tracker assumes."
    )
    return _with_band(f"nis-{number}", f"NIS of {sensor} over time", caption, "NIS", table, lines, "nis")


def _single_nis(table: pa.Table, sensor: str, lines: Sequence[_Line], number: int) -> Picture:
    limits = {point95(dof): dof for dof in sorted({int(dof) for dof in column(table, "dof")})}
    where_they_are = joined([f"{limit:.3f} ({dof} degrees of freedom)" for limit, dof in limits.items()])
    caption = (
        f"Squared innovation of {sensor} (measurement minus prediction) in units of its predicted covariance, each one "
        f"by itself. Of a consistent tracker 95 % are below the dashed line, at {where_they_are}. If fewer are, "
        "the noise or the motion is larger than the tracker assumes; if nearly all are, it is smaller."
    )

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel=_TIME, ylabel="NIS")
        _draw(axes, table, lines)
        for limit in limits:
            axes.axhline(limit, color=INK, linestyle=_DASHED, linewidth=1.3, zorder=3)
        axes.set_ylim(0, 1.06 * max(*limits, *(float(np.nanquantile(line.value, 0.995)) for line in lines)))

    name, title = f"nis-{number}", f"NIS of {sensor} over time"
    alternative = f"{title}, {_shown(lines)}, with the 95 % line of single innovations. {_ends(lines, '')}"
    svg = in_page(draw(paint, _HEIGHT), name, alternative, titles(line.look for line in lines))
    key = Entry("95 % of single innovations", "currentColor", "dash")
    return Picture(name, title, caption, alternative, svg, (*entries(line.look for line in lines), key))


def _with_band(
    name: str, title: str, caption: str, label: str, table: pa.Table, lines: Sequence[_Line], prefix: str
) -> Picture | None:
    if not lines:
        return None
    first = [lines[0].look]
    band = [*_lines(table, first, f"{prefix}_low"), *_lines(table, first, f"{prefix}_high")]

    def paint(figure: Figure) -> None:
        axes = figure.add_subplot(xlabel=_TIME, ylabel=label)
        if band:
            low, high = band
            axes.fill_between(low.time, low.value, high.value, color=MUTED, alpha=0.35)
        _draw(axes, table, lines)
        if fit_value_axis(axes, [line.value for line in (*lines, *band)]):
            axes.set_ylabel(f"{label}, logarithmic")

    alternative = f"{title}, {_shown(lines)}. {_ends(lines, '')}"
    key = [Entry("95 % bounds of a consistent tracker", "var(--muted)", "band")] if band else []
    svg = in_page(draw(paint, _HEIGHT), name, alternative, titles(line.look for line in lines))
    return Picture(name, title, caption, alternative, svg, (*entries(line.look for line in lines), *key))


def _draw(axes: Axes, table: pa.Table, lines: Sequence[_Line]) -> None:
    """The best tracker on top, over the whole time of ``table``."""
    for line in reversed(lines):
        look = line.look
        axes.plot(line.time, line.value, color=look.colour, linestyle=look.style, gid=look.key)
    _time_axis(axes, table)
    axes.grid(axis="x", color=GRID, linewidth=0.6)


def _time_axis(axes: Axes, table: pa.Table) -> None:
    axes.set_xlim(0, float(column(table, "time_s").max()))
    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))


def _lines(table: pa.Table, shown: Sequence[Look], name: str) -> list[_Line]:
    """The column ``name`` of each tracker that has one."""
    found = []
    for look in shown:
        rows = where(table, tracker=look.name)
        value = column(rows, name)
        if np.isfinite(value).any():
            found.append(_Line(look, column(rows, "time_s"), value))
    return found


def _smooth(lines: Sequence[_Line]) -> list[_Line]:
    """Root mean squares over equal stretches of time."""
    return [_Line(line.look, *_stretches(line.time, line.value)) for line in lines]


def _stretches(time: Array, value: Array) -> tuple[Array, Array]:
    size = max(1, round(len(time) / _POINTS))
    starts = np.arange(0, len(time) - size + 1, size)
    known = np.isfinite(value)
    count = np.add.reduceat(known.astype(float), starts)
    square = np.add.reduceat(np.where(known, value, 0.0) ** 2, starts)
    steps = np.add.reduceat(np.ones(len(time)), starts)
    return np.add.reduceat(time, starts) / steps, np.sqrt(square / np.where(count > 0, count, np.nan))


def _window(lines: Sequence[_Line]) -> str:
    return f"averaged over {np.diff(lines[0].time[:2]).sum():.2g} s"


def _distinct(lines: Sequence[_Line]) -> list[list[_Line]]:
    """Lines grouped by what they show: trackers of the same sensors have the same bound."""
    groups: list[list[_Line]] = []
    for line in lines:
        for group in groups:
            other = group[0]
            if other.value.shape == line.value.shape and np.allclose(other.value, line.value, equal_nan=True):
                group.append(line)
                break
        else:
            groups.append([line])
    return groups


def _bound_label(group: Sequence[_Line], groups: int) -> str:
    return "Cramér-Rao bound" if groups == 1 else f"bound of {joined([line.look.name for line in group])}"


def _shown(lines: Sequence[_Line]) -> str:
    return counted(len(lines), "tracker")


def _ends(lines: Sequence[_Line], unit: str) -> str:
    """The last value of each line, for those who cannot see it."""
    last = [(line.look.name, line.value[np.isfinite(line.value)][-1]) for line in lines]
    return "At the end: " + ", ".join(f"{name} {value:.3g} {unit}".strip() for name, value in last) + "."
