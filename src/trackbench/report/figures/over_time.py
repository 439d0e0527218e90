"""Figures of errors, NEES and GOSPA over time, with a line for each tracker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure as Canvas

from trackbench.base.errors import counted
from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry, TrackerStyle, end_of_axis
from trackbench.document.drawing import DASHED, INK, MUTED, TIME_LABEL, WIDTH, fit_value_axis, panel_title, time_axis
from trackbench.document.palette import tracker_figure
from trackbench.results import Result
from trackbench.results.columns import Columns, split

#: Points to which errors are averaged over time, as sensors that alternate would fill the figure with zigzag.
_POINTS = 100


class Line(NamedTuple):
    """Values of one tracker over time, drawn as a line."""

    style: TrackerStyle
    time: Array
    """Time of each value, s."""
    value: Array


#: Columns of the table "steps", by tracker.
Steps = Mapping[tuple[str, ...], Columns]


def tracker_lines(steps: Steps, styles: Sequence[TrackerStyle], column: str) -> list[Line]:
    """Return a line for each tracker with values in ``column`` of the table "steps"."""
    tables = ((style, steps.get((style.name,), {})) for style in styles)
    return [Line(s, rows["time_s"], rows[column]) for s, rows in tables if np.isfinite(rows.get(column, np.nan)).any()]


def smoothed_lines(steps: Steps, styles: Sequence[TrackerStyle], column: str) -> list[Line]:
    """Return a line for each tracker: RMS of ``column`` of the table "steps" in each of equal stretches of time."""
    lines = tracker_lines(steps, styles, column)
    return [Line(line.style, *_rms_over_stretches(line.time, line.value)) for line in lines]


def _rms_over_stretches(time: Array, value: Array) -> tuple[Array, Array]:
    size = max(1, round(len(time) / _POINTS))
    starts = np.arange(0, len(time) - size + 1, size)
    finite = np.isfinite(value)
    count = np.add.reduceat(finite.astype(float), starts)
    square = np.add.reduceat(np.where(finite, value, 0.0) ** 2, starts)
    steps = np.add.reduceat(np.ones(len(time)), starts)
    return np.add.reduceat(time, starts) / steps, np.sqrt(square / np.where(count > 0, count, np.nan))


class Panel(NamedTuple):
    """Panel of a figure: a quantity over time, with its reference or bounds."""

    label: str
    unit: str
    column: str
    reference: str = ""
    """Column, in the table "steps", of the Cramér-Rao reference, which is drawn dashed; empty for no reference."""
    band: tuple[str, ...] = ()
    """Columns, in the table "steps", of the lower and upper 95 % bounds for a consistent tracker; empty for none. A
    quantity with bounds is not averaged over time."""


OF_ESTIMATES = (
    Panel("position RMSE", "m", "position_rmse_m", "position_reference_m"),
    Panel("velocity RMSE", "m/s", "velocity_rmse_mps", "velocity_reference_mps"),
    Panel("NEES", "", "nees_mean", band=("nees_low", "nees_high")),
)
OF_TRACKS = (
    Panel("GOSPA", "m", "gospa_m"),
    Panel("localisation", "m", "gospa_localisation_m"),
    Panel("missed", "m", "gospa_missed_m"),
    Panel("false", "m", "gospa_false_m"),
)
#: Height of a figure without its panels, and least height of a panel, points.
_MARGIN, _PANEL = 40.0, 120.0


def errors_over_time(result: Result, styles: Sequence[TrackerStyle]) -> Figure | None:
    """Return a figure of position and velocity RMSE with reference, and NEES with bounds; None without values."""
    reference = result.summary.held_against
    caption = (
        f"Over all runs and objects. Dashed: the {reference.label}. {reference.meaning} NEES: squared error over the "
        "covariance that the tracker states; a consistent tracker is in the grey band 95 % of the time, above it "
        "errors are larger than stated, below it smaller."
    )
    return _panels("errors", "Errors over time", caption, result, styles, OF_ESTIMATES, reference.label)


def gospa_over_time(result: Result, styles: Sequence[TrackerStyle]) -> Figure | None:
    """Return a figure of GOSPA and its parts over time; None if there are no values."""
    caption = (
        "Root mean square over all runs. The squares of the parts add up to that of GOSPA: localisation is the "
        "distance of tracks from their objects, missed what objects without a track cost, false what tracks without "
        "an object do."
    )
    return _panels("gospa", "GOSPA over time", caption, result, styles, OF_TRACKS)


def _panels(
    name: str,
    title: str,
    caption: str,
    result: Result,
    styles: Sequence[TrackerStyle],
    panels: Sequence[Panel],
    label: str = "",
) -> Figure | None:
    """Return a figure with the panels that have values, one below the other; None if no panel has any."""
    steps = split(result.tables.steps, "tracker")
    lines = {panel: (tracker_lines if panel.band else smoothed_lines)(steps, styles, panel.column) for panel in panels}
    drawn = {panel: of_panel for panel, of_panel in lines.items() if of_panel}
    if not drawn:
        return None
    references = {
        panel: _distinct(smoothed_lines(steps, styles, panel.reference)) for panel in drawn if panel.reference
    }
    bands = {panel: [line for name in panel.band for line in tracker_lines(steps, styles[:1], name)] for panel in drawn}
    first = next(iter(drawn))

    def paint(canvas: Canvas) -> None:
        all_axes = canvas.subplots(len(drawn), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (panel, of_panel) in zip(all_axes, drawn.items(), strict=True):
            if bands[panel]:
                low, high = bands[panel]
                # The band lies in front of lines that zigzag through it.
                axes.fill_between(low.time, low.value, high.value, color=MUTED, alpha=0.35, linewidth=0, zorder=3)
            # The best tracker is drawn last, on top.
            for style, time, value in reversed(of_panel):
                axes.plot(time, value, **style.line_options)
            for line in references.get(panel, []):
                axes.plot(line.time, line.value, color=INK, linestyle=DASHED, linewidth=1.3)
            sizes = {line.style.name: float(np.sqrt(np.nanmean(line.value**2))) for line in of_panel}
            end = end_of_axis(sizes.values())
            cut = {line.style.name: np.nanmax(line.value) for line in of_panel if sizes[line.style.name] > end}
            shown = [line.value for line in (*of_panel, *references.get(panel, [])) if line.style.name not in cut]
            is_logarithmic = fit_value_axis(axes, [*shown, *(line.value for line in bands[panel])])
            beyond = [f"{name} beyond the axis: up to {peak:.3g} {panel.unit}".rstrip() for name, peak in cut.items()]
            panel_title(axes, "; ".join(beyond), WIDTH)
            unit = f", {panel.unit}" if panel.unit else ""
            axes.set_ylabel(f"{panel.label}{unit}{' (log)' * is_logarithmic}")
            time_axis(axes, max(float(rows["time_s"].max()) for rows in steps.values()))
        all_axes[-1].set_xlabel(TIME_LABEL)

    shown_styles = [line.style for line in drawn[first]]
    last = [(line.style.name, line.value[np.isfinite(line.value)][-1]) for line in drawn[first]]
    ends = ", ".join(f"{name} {value:.3g} {first.unit}" for name, value in last)
    return tracker_figure(
        name,
        title,
        caption,
        f"{title}, {counted(len(shown_styles), 'tracker')}. At the end: {ends}.",
        paint,
        _MARGIN + max(_PANEL, 420.0 / len(drawn) - _MARGIN) * len(drawn),
        shown_styles,
        *([LegendEntry(label, INK, "dash")] if any(references.values()) else []),
        *([LegendEntry("95 % bounds of a consistent tracker", MUTED, "band")] if any(bands.values()) else []),
    )


def _distinct(drawn: Sequence[Line]) -> list[Line]:
    """Return each distinct line once, since trackers with the same sensors have equal references."""
    unique: list[Line] = []
    for line in drawn:
        comparable = (other.value for other in unique if other.value.shape == line.value.shape)
        if not any(np.allclose(value, line.value, equal_nan=True) for value in comparable):
            unique.append(line)
    return unique
