"""Maps over two axes: the state of each cell, the border with its band, and the borders of several trackers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from trackbench.base.errors import counted
from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry, TrackerStyle
from trackbench.document.drawing import (
    HATCHES,
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
from trackbench.subjects.envelope.margins import Border, Slice, border_of, distance_from, slices

#: Distinct to a colour-blind reader, and by their hatch.
STATE_COLOURS: dict[State, str] = {"holds": "#009E73", "fails": "#D55E00", "undecided": MUTED}
#: Marker of a cell, its size in points and its fill.
_MARKS = {"holds": ("o", 3.0, INK), "fails": ("x", 4.0, INK), "undecided": ("o", 3.5, "none")}
#: Where the scenario itself is, as a legend names it.
OWN = LegendEntry("the scenario", INK, "triangle")
#: Panels of one figure, at most, and beside each other.
MOST_PANELS, _BESIDE = 9, 2
#: Of a single panel, and of one of several; points.
_TALL, _LOW = 310.0, 190.0


def pairs_of(claim: Claim) -> list[tuple[int, int]]:
    """The numbers of each two axes that are numbers."""
    return [*combinations([i for i, axis in enumerate(claim.axes) if axis.ordered], 2)]


def map_figure(claim: Claim, pair: tuple[int, int], style: TrackerStyle) -> Figure:
    """The cells of one tracker over two axes, with its border."""
    parts, mark, left_out = _shown(claim, pair)

    def paint(canvas: Canvas) -> None:
        for panel, part in zip(_panels(canvas, parts), parts, strict=False):
            border = border_of(part, claim, style.name)
            _paint_areas(panel, part, border)
            _paint_line(panel, part, border, INK)
            _paint_cells(panel, part, style.name)
            _finish(panel, part, mark)
        _label(canvas, parts)

    legend = [
        LegendEntry("between cells that hold", STATE_COLOURS["holds"], "band"),
        LegendEntry("between cells that fail", STATE_COLOURS["fails"], "hatched"),
        LegendEntry("between others", STATE_COLOURS["undecided"], "lined"),
        LegendEntry("border, interpolated", INK),
        *([OWN] if mark else []),
    ]
    counts = claim.counts(style.name)
    required = " and ".join(limit.text for limit in claim.limits_of(style.name))
    caption = (
        f"{required}. Cells that hold are dots, those that fail crosses, undecided ones rings; the small ones were "
        "added near the border. What is claimed is the cells. Between them an area is coloured by its three cells "
        "where they are alike; where they are not, it is lined, and the border in it is interpolated."
    )
    return Figure(
        f"map-{_file(style.name)}-{_names(parts)}",
        f"{style.name}: {parts[0].across.name} and {parts[0].up.name}",
        caption + left_out,
        f"Map of {style.name} over {parts[0].across.name} and {parts[0].up.name}: it "
        + ", ".join(f"{state} in {counted(counts[state], 'cell')}" for state in ("holds", "fails"))
        + f", {counts['undecided']} undecided",
        paint,
        _height(parts),
        legend=tuple(legend),
    )


def borders_figure(claim: Claim, pair: tuple[int, int], styles: Sequence[TrackerStyle]) -> Figure:
    """The borders of several trackers over two axes."""
    parts, mark, left_out = _shown(claim, pair)

    def paint(canvas: Canvas) -> None:
        for panel, part in zip(_panels(canvas, parts), parts, strict=False):
            unseen = []
            for style in styles:
                border = border_of(part, claim, style.name)
                _paint_line(panel, part, border, style.colour, style)
                # A border of no length runs through a cell at the edge whose value is that of the limit.
                if np.ptp(border.segments, axis=1).sum() < 1e-9 and (said := _all_alike(part.states(style.name))):
                    unseen.append(f"{shortened_to_width(style.name, WIDTH / _BESIDE - 140, 8)}: {said}")
            # Bottom left, and in ink: it is read on every band.
            panel.text(0.04, 0.06, "\n".join(unseen), transform=panel.transAxes, fontsize=8, color=INK, zorder=5)
            _finish(panel, part, mark)
        _label(canvas, parts)

    lines = (LegendEntry(s.name, s.colour, "line" if s.line == "solid" else "dash", s.key) for s in styles)
    return Figure(
        f"borders-{_names(parts)}",
        f"Borders over {parts[0].across.name} and {parts[0].up.name}",
        "Where each tracker stops to meet its requirement, interpolated; the band is the area between cells that are "
        "not alike or are undecided." + left_out,
        f"The borders of {counted(len(styles), 'tracker')} over {parts[0].across.name} and {parts[0].up.name}",
        paint,
        _height(parts),
        legend=(*lines, *([OWN] if mark else [])),
        tooltips={style.key: style.name for style in styles},
    )


def _all_alike(states: Sequence[State]) -> str:
    """What is said of cells between which there is no border; empty where they lie on one line and differ."""
    words = {"holds": "all hold", "fails": "none holds", "undecided": "not decided"}
    if len(found := set(states)) == 1:
        return words[states[0]]
    return "" if {"holds", "fails"} <= found else "not all decided"


class _Mark(NamedTuple):
    """Where the scenario itself is shown."""

    part: Slice
    """In which it lies, or to which it is nearest."""
    at: tuple[float, float]


class _Shown(NamedTuple):
    """What a figure shows."""

    parts: list[Slice]
    mark: _Mark | None
    """None where the map does not reach to it."""
    left_out: str
    """A sentence on what is not shown."""


def _shown(claim: Claim, pair: tuple[int, int]) -> _Shown:
    """Return the slices that are nearest to the scenario itself."""
    every = slices(claim, *pair)
    kept = sorted(every, key=lambda part: distance_from(claim.own_values, part.at))[:MOST_PANELS]
    text = f" Of {len(every)} slices those nearest to the scenario are shown." if len(kept) < len(every) else ""
    if missing := len(claim.cells) - sum(len(part.cells) for part in every):
        text += f" {counted(missing, 'cell')} between the slices are in the table alone."
    return _Shown([part for part in every if any(part is other for other in kept)], _own_mark(claim, kept), text)


def _own_mark(claim: Claim, parts: Sequence[Slice]) -> _Mark | None:
    across, up, values = parts[0].across, parts[0].up, claim.own_values
    x, y = values[across.name], values[up.name]
    if not (across.reaches(x) and up.reaches(y)):
        return None
    part = min(parts, key=lambda part: distance_from(values, part.at))
    return _Mark(part, (float(x), float(y)))  # type: ignore[arg-type]


def _paint_areas(panel: Axes, part: Slice, border: Border) -> None:
    """What lies between cells of one state."""
    for state, colour in STATE_COLOURS.items():
        whole = _path(_scaled(part, border.area(state)))
        if state != "undecided":
            panel.add_patch(PathPatch(whole, facecolor=colour, alpha=0.35, linewidth=0))
        if state != "holds":
            hatch = HATCHES["hatched" if state == "fails" else "lined"]
            panel.add_patch(PathPatch(whole, facecolor="none", edgecolor=colour, hatch=hatch, linewidth=0))


def _path(corners: Array) -> Path:
    """``(triangles, 3, 2)`` as one path: fine lines are left between several."""
    closed = np.concatenate([corners, corners[:, :1]], axis=1).reshape(-1, 2)
    return Path(closed, np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(corners)))


def _paint_line(panel: Axes, part: Slice, border: Border, colour: str, style: TrackerStyle | None = None) -> None:
    """The border; of one tracker of several its band too."""
    look: dict[str, Any] = {"linestyle": style.line, "gid": style.key} if style else {}
    if style:
        band = _path(_scaled(part, border.area("undecided")))
        panel.add_patch(PathPatch(band, facecolor=colour, alpha=0.25, linewidth=0, gid=style.key))
    ends = _scaled(part, border.segments)
    apart = np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1).reshape(-1, 2)
    panel.plot(*apart.T, color=colour, linewidth=2.0, **look)


def _paint_cells(panel: Axes, part: Slice, tracker: str) -> None:
    """Each by its state, those that were added smaller."""
    added, states = np.array([cell.added for cell in part.cells]), np.array(part.states(tracker))
    for state, (marker, size, face) in _MARKS.items():
        for later, smaller in ((False, 1.0), (True, 0.7)):
            x, y = _scaled(part, part.places[(states == state) & (added == later)]).T
            panel.plot(
                x, y, linestyle="none", marker=marker, markersize=size * smaller, color=INK, markerfacecolor=face,
                markeredgewidth=0.7, clip_on=False, zorder=3,
            )  # fmt: skip


def _finish(panel: Axes, part: Slice, mark: _Mark | None) -> None:
    """The mark of the scenario, why there are no cells elsewhere, and the axes."""
    for height, text in part.absent:
        edge = "top" if height > 0.5 else "bottom"
        panel.text(0.5, height, text, transform=panel.transAxes, fontsize=8, color=INK, ha="center", va=edge)
    if mark is not None and mark.part is part:
        panel.plot(*mark.at, marker=MARKERS[OWN.mark][0], markersize=9, color=INK, clip_on=False, zorder=4)
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
        if part.at:
            panel_title(panel, ", ".join(f"{axis.name} {axis.shown(v)}" for axis, v in part.at), WIDTH / across)
    return panels


def _label(canvas: Canvas, parts: Sequence[Slice]) -> None:
    panels, across = canvas.axes, min(_BESIDE, len(parts))
    for place, panel in enumerate(panels[: len(parts)]):
        if place % across == 0:
            panel.set_ylabel(
                shortened_to_width(axis_label(parts[0].up), _height(parts) / -(-len(parts) // across) - 40)
            )
        if place // across == (len(parts) - 1) // across:
            panel.set_xlabel(shortened_to_width(axis_label(parts[0].across), WIDTH / across - 60))


def axis_label(axis: MapAxis) -> str:
    """With its unit."""
    return f"{axis.name}, {axis.unit}" if axis.unit else axis.name


def _height(parts: Sequence[Slice]) -> float:
    return _TALL if len(parts) == 1 else _LOW * -(-len(parts) // _BESIDE)


def _scaled(part: Slice, places: Array) -> Array:
    """``(..., 2)`` from shares to values of the two axes."""
    return np.stack([part.across.exactly_at(places[..., 0]), part.up.exactly_at(places[..., 1])], axis=-1)


def _names(parts: Sequence[Slice]) -> str:
    return f"{_file(parts[0].across.name)}-{_file(parts[0].up.name)}"


def _file(name: str) -> str:
    return name.replace(".", "-").replace("_", "-")
