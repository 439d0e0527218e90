"""Figures over time: errors, GOSPA, NEES and NIS, a line for each tracker from a result's tables."""

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

#: Errors are averaged over time to about so many points, or a sensor that alternates with another fills the figure.
_POINTS = 100


class Line(NamedTuple):
    """What is drawn of one tracker."""

    style: TrackerStyle
    time: Array
    """s"""
    value: Array


#: By tracker, its columns of the table "steps".
Steps = Mapping[tuple[str, ...], Columns]


def lines(steps: Steps, styles: Sequence[TrackerStyle], name: str) -> list[Line]:
    """Return the column ``name`` of each tracker that has values in it."""
    own = ((style, steps.get((style.name,), {})) for style in styles)
    return [Line(style, rows["time_s"], rows[name]) for style, rows in own if np.isfinite(rows.get(name, np.nan)).any()]


def smooth_lines(steps: Steps, styles: Sequence[TrackerStyle], name: str) -> list[Line]:
    """The same as root mean squares over equal stretches of time."""
    return [Line(line.style, *_stretches(line.time, line.value)) for line in lines(steps, styles, name)]


def _stretches(time: Array, value: Array) -> tuple[Array, Array]:
    size = max(1, round(len(time) / _POINTS))
    starts = np.arange(0, len(time) - size + 1, size)
    finite = np.isfinite(value)
    count = np.add.reduceat(finite.astype(float), starts)
    square = np.add.reduceat(np.where(finite, value, 0.0) ** 2, starts)
    steps = np.add.reduceat(np.ones(len(time)), starts)
    return np.add.reduceat(time, starts) / steps, np.sqrt(square / np.where(count > 0, count, np.nan))


class Panel(NamedTuple):
    """A quantity over time, and what it is held against."""

    label: str
    unit: str
    column: str
    reference: str = ""
    """Column of the reference, which is drawn dashed; empty without one."""
    band: tuple[str, ...] = ()
    """Columns of the bounds of a consistent tracker; a statistic with bounds is not averaged over time."""

    @property
    def axis_label(self) -> str:
        """The quantity with its unit."""
        return f"{self.label}, {self.unit}" if self.unit else self.label


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
#: Points of a figure without its panels, and of the lowest panel.
_MARGIN, _PANEL = 40.0, 120.0


def errors_over_time(result: Result, styles: Sequence[TrackerStyle]) -> Figure | None:
    """RMSE of position and velocity with the reference, and NEES with its bounds; None if there is nothing to draw."""
    reference = result.summary.held_against
    caption = (
        f"Over all runs and objects. Dashed: the {reference.label}. {reference.meaning} NEES: squared error over the "
        "covariance that the tracker states; a consistent tracker is in the grey band 95 % of the time, above it "
        "errors are larger than stated, below it smaller."
    )
    return _panels("errors", "Errors over time", caption, result, styles, OF_ESTIMATES, reference.label)


def gospa_over_time(result: Result, styles: Sequence[TrackerStyle]) -> Figure | None:
    """GOSPA and its parts over time; None if there is nothing to draw."""
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
    """A panel for each quantity, one below the other; a tracker that is far out does not set an axis."""
    steps = split(result.tables.steps, "tracker")
    drawn = {
        panel: own for panel in panels if (own := (lines if panel.band else smooth_lines)(steps, styles, panel.column))
    }
    if not drawn:
        return None
    references = {panel: _distinct(smooth_lines(steps, styles, panel.reference)) for panel in drawn if panel.reference}
    bands = {panel: [line for name in panel.band for line in lines(steps, styles[:1], name)] for panel in drawn}
    first = next(iter(drawn))

    def paint(canvas: Canvas) -> None:
        every = canvas.subplots(len(drawn), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (panel, own) in zip(every, drawn.items(), strict=True):
            if bands[panel]:
                low, high = bands[panel]
                # In front of a line that goes up and down through it.
                axes.fill_between(low.time, low.value, high.value, color=MUTED, alpha=0.35, linewidth=0, zorder=3)
            # The best tracker on top.
            for style, time, value in reversed(own):
                axes.plot(time, value, **style.line_options)
            held_against = references.get(panel, [])
            for line in held_against:
                axes.plot(line.time, line.value, color=INK, linestyle=DASHED, linewidth=1.3)
            sizes = {line.style.name: float(np.sqrt(np.nanmean(line.value**2))) for line in own}
            end = end_of_axis(sizes.values())
            far = {line.style.name: np.nanmax(line.value) for line in own if sizes[line.style.name] > end}
            near = [line.value for line in (*own, *held_against) if line.style.name not in far]
            is_logarithmic = fit_value_axis(axes, [*near, *(line.value for line in bands[panel])])
            beyond = [f"{name} beyond the axis: up to {peak:.3g} {panel.unit}".rstrip() for name, peak in far.items()]
            panel_title(axes, "; ".join(beyond), WIDTH)
            axes.set_ylabel(f"{panel.axis_label}{' (log)' * is_logarithmic}")
            time_axis(axes, max(float(rows["time_s"].max()) for rows in steps.values()))
        every[-1].set_xlabel(TIME_LABEL)

    shown = [line.style for line in drawn[first]]
    last = [(line.style.name, line.value[np.isfinite(line.value)][-1]) for line in drawn[first]]
    ends = ", ".join(f"{name} {value:.3g} {first.unit}" for name, value in last)
    return tracker_figure(
        name,
        title,
        caption,
        f"{title}, {counted(len(shown), 'tracker')}. At the end: {ends}.",
        paint,
        _MARGIN + max(_PANEL, 420.0 / len(drawn) - _MARGIN) * len(drawn),
        shown,
        *([LegendEntry(label, INK, "dash")] if any(references.values()) else []),
        *([LegendEntry("95 % bounds of a consistent tracker", MUTED, "band")] if any(bands.values()) else []),
    )


def _distinct(drawn: Sequence[Line]) -> list[Line]:
    """One line of those that are the same: trackers of the same sensors have the same reference."""
    unique: list[Line] = []
    for line in drawn:
        alike = (other for other in unique if other.value.shape == line.value.shape)
        if not any(np.allclose(other.value, line.value, equal_nan=True) for other in alike):
            unique.append(line)
    return unique
