"""Figures over two axes: the state of each cell, the border with its band, and the borders of several trackers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from trackbench.base.errors import counted
from trackbench.document import Figure, LegendEntry, TrackerStyle
from trackbench.document.drawing import (
    INK,
    MARKERS,
    MUTED,
    WIDTH,
    logarithmic,
    panel_title,
    shortened_to_width,
)
from trackbench.subjects.envelope.axes import MapAxis
from trackbench.subjects.envelope.claim import Claim, State
from trackbench.subjects.envelope.margins import Border, Slice, border_of, distance_from_base, slices

#: Colours that a colour-blind reader can tell apart; the markers of the cells show the states as well.
STATE_COLOURS: dict[State, str] = {"holds": "#009E73", "fails": "#D55E00", "undecided": MUTED}
#: Marker of a cell, its size in points and its fill.
_MARKS = {"holds": ("o", 3.0, INK), "fails": ("x", 4.0, INK), "undecided": ("o", 3.5, "none")}
#: Mark at the scenario's own values of both axes.
OWN = LegendEntry("the scenario's values", INK, "triangle")
#: Largest number of panels of a figure, and of panels beside each other.
MOST_PANELS, _BESIDE = 9, 2
#: Height of a single panel, and of one of several, in points.
_TALL, _LOW = 310.0, 190.0


def pairs_of(claim: Claim) -> list[tuple[int, int]]:
    """Return all pairs of numeric axes, each as two indices in ``claim.axes``."""
    return [*combinations([i for i, axis in enumerate(claim.axes) if axis.ordered], 2)]


def map_figure(claim: Claim, pair: tuple[int, int], style: TrackerStyle) -> Figure:
    """Return the figure of one tracker's cells over two axes, with its border."""
    parts, left_out = _nearest_slices(claim, pair)

    def paint(canvas: Canvas) -> None:
        for panel, part in zip(_panels(canvas, parts), parts, strict=False):
            border = border_of(part, claim, style.name)
            for state, colour in STATE_COLOURS.items():
                _paint_area(panel, border, state, colour)
            _paint_line(panel, border, INK)
            _paint_cells(panel, part, style.name)
            _paint_scenario_and_axes(panel, part, claim)

    legend = [
        LegendEntry("between cells that hold", STATE_COLOURS["holds"], "band"),
        LegendEntry("between cells that fail", STATE_COLOURS["fails"], "band"),
        LegendEntry("between others", STATE_COLOURS["undecided"], "band"),
        LegendEntry("border, interpolated", INK),
        *([OWN] if _own_place(claim, parts[0]) else []),
    ]
    counts = claim.counts(style.name)
    required = " and ".join(limit.text for limit in claim.limits_of(style.name))
    caption = (
        f"{required}. Cells that hold are dots, those that fail crosses, those not shown to do either rings; "
        "the small ones were added near the border. Only the cells are claimed. An area between three cells has their "
        "colour if they are alike; else it is grey, and the border in it is interpolated."
    )
    return Figure(
        f"map-{_file(style.name)}-{_names(parts)}",
        f"{style.name}: {parts[0].across.name} and {parts[0].up.name}",
        caption + left_out,
        f"Map of {style.name} over {parts[0].across.name} and {parts[0].up.name}: it "
        + ", ".join(f"{state} in {counted(counts[state], 'cell')}" for state in ("holds", "fails"))
        + f", {counts['undecided']} not shown",
        paint,
        _height(parts),
        legend=tuple(legend),
    )


def borders_figure(claim: Claim, pair: tuple[int, int], styles: Sequence[TrackerStyle]) -> Figure:
    """Return the figure of several trackers' borders over two axes."""
    parts, left_out = _nearest_slices(claim, pair)

    def paint(canvas: Canvas) -> None:
        for panel, part in zip(_panels(canvas, parts), parts, strict=False):
            unseen = []
            for style in styles:
                border = border_of(part, claim, style.name)
                _paint_area(panel, border, "undecided", style.colour, style.key)
                _paint_line(panel, border, style.colour, style)
                if not (border and border.is_line) and (remark := _no_border_remark(part.states(style.name))):
                    unseen.append(f"{shortened_to_width(style.name, WIDTH / _BESIDE - 140, 8)}: {remark}")
            # Ink is legible on every band.
            panel.text(0.04, 0.06, "\n".join(unseen), transform=panel.transAxes, fontsize=8, color=INK, zorder=5)
            _paint_scenario_and_axes(panel, part, claim)

    lines = (LegendEntry(s.name, s.colour, "line" if s.line == "solid" else "dash", s.key) for s in styles)
    return Figure(
        f"borders-{_names(parts)}",
        f"Borders over {parts[0].across.name} and {parts[0].up.name}",
        "Where each tracker stops meeting its requirement, interpolated; the band is the area between cells that are "
        "not alike or are not shown to hold or to fail." + left_out,
        f"The borders of {counted(len(styles), 'tracker')} over {parts[0].across.name} and {parts[0].up.name}",
        paint,
        _height(parts),
        legend=(*lines, *([OWN] if _own_place(claim, parts[0]) else [])),
        tooltips={style.key: style.name for style in styles},
    )


def _no_border_remark(states: Sequence[State]) -> str:
    """Return a remark on a slice without a border; empty where cells hold and fail but lie on one line."""
    words = {"holds": "all hold", "fails": "none holds", "undecided": "not shown"}
    if len(distinct := set(states)) == 1:
        return words[states[0]]
    return "" if {"holds", "fails"} <= distinct else "not all shown"


def _nearest_slices(claim: Claim, pair: tuple[int, int]) -> tuple[list[Slice], str]:
    """Return the slices (cells over two axes) nearest to the scenario, and a sentence on slices that are not drawn."""
    parts = slices(claim, *pair)
    nearest = sorted(parts, key=lambda part: distance_from_base(claim, part.at))[:MOST_PANELS]
    text = f" Of {len(parts)} slices those nearest to the scenario are shown." if len(nearest) < len(parts) else ""
    return [part for part in parts if any(part is other for other in nearest)], text


def _own_place(claim: Claim, part: Slice) -> list[Any]:
    """Return the scenario's own values of the two axes; empty where they lie outside the map."""
    axes, values = (part.across, part.up), [claim.own_values[axis.name] for axis in (part.across, part.up)]
    return values if all(map(MapAxis.reaches, axes, values)) else []


def _paint_area(panel: Axes, border: Border | None, state: State, colour: str, key: str | None = None) -> None:
    """Paint the triangles of a state as one path, since separate patches leave fine lines between them."""
    if border is not None:
        corners = border.mesh.triangles[np.array(border.areas) == state]
        polygons = np.stack([border.mesh.x[corners], border.mesh.y[corners]], axis=-1)
        area = Path.make_compound_path_from_polys(polygons)
        panel.add_patch(PathPatch(area, facecolor=colour, alpha=0.35, linewidth=0, gid=key, transform=panel.transAxes))


def _paint_line(panel: Axes, border: Border | None, colour: str, style: TrackerStyle | None = None) -> None:
    if border is not None and border.is_line:
        line = panel.tricontour(
            border.mesh, border.beyond, levels=[0.0], colors=colour, linewidths=2.0,
            linestyles=style.line if style else "solid", transform=panel.transAxes,
        )  # fmt: skip
        line.set_gid(style.key if style else None)


def _paint_cells(panel: Axes, part: Slice, tracker: str) -> None:
    added, states = np.array([cell.added for cell in part.cells]), np.array(part.states(tracker))
    for state, (marker, size, face) in _MARKS.items():
        for later, smaller in ((False, 1.0), (True, 0.7)):
            x, y = part.places[(states == state) & (added == later)].T
            panel.plot(
                x, y, linestyle="none", marker=marker, markersize=size * smaller, color=INK, markerfacecolor=face,
                markeredgewidth=0.7, clip_on=False, zorder=3, transform=panel.transAxes,
            )  # fmt: skip


def _paint_scenario_and_axes(panel: Axes, part: Slice, claim: Claim) -> None:
    if values := _own_place(claim, part):
        panel.plot(*values, marker=MARKERS[OWN.mark][0], markersize=9, color=INK, clip_on=False, zorder=4)
    panel.set_xlim(*part.across.ends)
    panel.set_ylim(*part.up.ends)
    if part.across.config.scale == "log":
        logarithmic(panel, "x")
    if part.up.config.scale == "log":
        logarithmic(panel, "y")
    panel.grid(visible=False)


def _panels(canvas: Canvas, parts: Sequence[Slice]) -> list[Axes]:
    across = min(_BESIDE, len(parts))
    down = -(-len(parts) // across)
    panels = list(canvas.subplots(down, across, squeeze=False, sharex=True, sharey=True).ravel())
    for panel in panels[len(parts) :]:
        panel.set_visible(False)
    for panel, part in zip(panels, parts, strict=False):
        panel.set_xlabel(shortened_to_width(axis_label(part.across), WIDTH / across - 60))
        panel.set_ylabel(shortened_to_width(axis_label(part.up), _height(parts) / down - 40))
        panel.label_outer()
        if part.at:
            panel_title(panel, ", ".join(f"{axis.name} {axis.shown(v)}" for axis, v in part.at), WIDTH / across)
    return panels


def axis_label(axis: MapAxis) -> str:
    """Return the name of an axis with its unit."""
    return f"{axis.name}, {axis.unit}" if axis.unit else axis.name


def _height(parts: Sequence[Slice]) -> float:
    return _TALL if len(parts) == 1 else _LOW * -(-len(parts) // _BESIDE)


def _names(parts: Sequence[Slice]) -> str:
    return f"{_file(parts[0].across.name)}-{_file(parts[0].up.name)}"


def _file(name: str) -> str:
    return name.replace(".", "-").replace("_", "-")
