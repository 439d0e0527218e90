"""Figures of a metric against one axis: values with bounds, the limit, and the band in which the border lies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry, TrackerStyle
from trackbench.document.drawing import (
    DASHED,
    INK,
    WIDTH,
    fit_value_axis,
    logarithmic,
    panel_title,
    shortened_to_width,
)
from trackbench.document.palette import tracker_figure
from trackbench.subjects.envelope.axes import MapAxis
from trackbench.subjects.envelope.claim import Claim, ClaimedLimit
from trackbench.subjects.envelope.map_figures import MOST_PANELS, axis_label
from trackbench.subjects.envelope.margins import AxisMargin, margins, place_of_line

#: Height of one panel, in points.
_HEIGHT = 200.0
#: Room beyond each end of the axis, as a share of the axis.
_ROOM = 0.03
#: Marker and size of each state: filled, hollow or a cross, so that no state depends on colour.
_MARKERS = {"holds": ("o", 4.5), "undecided": ("o", 4.5), "fails": ("x", 5.5)}


def line_figures(claim: Claim, styles: Sequence[TrackerStyle]) -> Iterator[Figure]:
    """Yield a figure for each axis of numbers and each metric that has a requirement."""
    all_margins = [margin for style in styles for margin in margins(claim, style.name)]
    for axis in claim.axes:
        lines = [margin for margin in all_margins if margin.axis.name == axis.name]
        if lines:
            for metric in dict.fromkeys(_metric_with_unit(limit) for limit in claim.limits):
                yield _figure(claim, axis, metric, lines, styles)


def _metric_with_unit(limit: ClaimedLimit) -> str:
    return limit.metric if limit.unit == "1" else f"{limit.metric}, {limit.unit}"


def _figure(
    claim: Claim, axis: MapAxis, metric: str, lines: Sequence[AxisMargin], styles: Sequence[TrackerStyle]
) -> Figure:
    places = list(dict.fromkeys(place_of_line(margin) for margin in lines))[:MOST_PANELS]

    def paint(canvas: Canvas) -> None:
        panels = canvas.subplots(len(places), 1, squeeze=False, sharex=True)[:, 0]
        drawn: list[Array] = []
        for panel, place in zip(panels, places, strict=True):
            for style in styles:
                for margin in lines:
                    if margin.tracker == style.name and place_of_line(margin) == place:
                        drawn += _paint_line(panel, margin, claim, metric, style)
            if len(places) > 1:
                panel_title(panel, place, WIDTH)
            panel.set_ylabel(shortened_to_width(metric, _HEIGHT - 40))
        for panel in panels:
            # A logarithmic axis would not show values of either sign.
            if all((values[np.isfinite(values)] > 0).all() for values in drawn):
                fit_value_axis(panel, drawn)
        # Room for the dots and bars at both ends.
        panels[-1].set_xlim(*axis.exactly_at(np.array([-_ROOM, 1 + _ROOM])))
        if axis.config.scale == "log":
            logarithmic(panels[0], "x")
        panels[-1].set_xlabel(shortened_to_width(axis_label(axis), WIDTH - 60))

    at = f" Along {places[0]}." if len(places) == 1 and places[0] else ""
    others = [LegendEntry("limit", INK, "dash"), LegendEntry("holds", INK, "dot"), LegendEntry("fails", INK, "cross")]
    return tracker_figure(
        f"line-{axis.name}-{metric.partition(',')[0]}".replace("_", "-").replace(".", "-").replace(" ", "-"),
        f"{metric.partition(',')[0]} over {axis.name}",
        "Each bar reaches between the bounds by which the cell is decided; those not shown to do "
        f"either have a hollow dot. Shaded: the band of the border.{at}",
        f"{metric} over {axis.name}, with the limit",
        paint,
        _HEIGHT * len(places) + 30,
        styles,
        *others,
    )


def _paint_line(panel: Axes, margin: AxisMargin, claim: Claim, metric: str, style: TrackerStyle) -> list[Array]:
    """Paint the line of one tracker; return all values that the vertical axis must cover."""
    drawn = []
    for place, limit in enumerate(claim.limits_of(style.name)):
        if _metric_with_unit(limit) != metric:
            continue
        rows = [(x, cell.trackers[style.name].values) for x, cell in margin.cells]
        cells = [(x, values[place]) for x, values in rows if values and values[place].value is not None]
        if not cells:
            continue
        x = np.array([value for value, _ in cells])
        y, low, high = (
            np.array([np.nan if v is None else v for v in column], dtype=float)
            for column in zip(*((cell.value, cell.low, cell.high) for _, cell in cells), strict=True)
        )
        panel.plot(x, y, color=style.colour, linestyle=style.line, linewidth=1.2, gid=style.key)
        panel.vlines(x, low, high, color=style.colour, linewidth=1.2, gid=style.key)
        for state, (marker, size) in _MARKERS.items():
            has_state = np.array([cell.state == state for _, cell in cells])
            face = "white" if state == "undecided" else style.colour
            panel.plot(
                x[has_state], y[has_state], linestyle="none", marker=marker, markersize=size, color=style.colour,
                markerfacecolor=face, gid=style.key,
            )  # fmt: skip
        panel.axhline(limit.limit, color=INK, linestyle=DASHED, linewidth=1.0)
        drawn += [y, low, high, np.array([limit.limit])]
    for crossing in margin.crossings:
        panel.axvspan(crossing.low, crossing.high, color=style.colour, alpha=0.18, linewidth=0, gid=style.key)
        panel.axvline(crossing.point, color=style.colour, linewidth=1.2, linestyle=style.line, gid=style.key)
    return drawn
