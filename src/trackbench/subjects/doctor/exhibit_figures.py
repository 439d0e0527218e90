"""The figure of a finding: one kind for each kind of exhibit."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from trackbench.base.types import Array
from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import DASHED, INK, MARKERS, MUTED, WIDTH, text_width
from trackbench.metrics.consistency import point95
from trackbench.subjects.doctor.drive_figures import REFERENCE, TRACKER, captioned_figure, over_time_figure
from trackbench.subjects.doctor.exhibits import (
    STATE,
    Covariances,
    Exhibit,
    Matrices,
    OverTime,
    Panel,
    Points,
    Predictions,
    StatedBelief,
)

Mark = Literal["line", "dash", "dot", "ring", "cross"]
_COLOURS = {"tracker": TRACKER, "right": REFERENCE, "before": MUTED}
_PLANES = {"position": slice(0, 2), "velocity": slice(2, 4)}
_UNITS = {"position": "m", "velocity": "m/s"}
#: The tracker's lies on top of the one before where it is the same.
_LINES = {"before": ("solid", 4.0), "right": ("solid", 1.6), "tracker": (DASHED, 1.6)}
_MARKS: dict[str, Mark] = {"before": "dot", "right": "ring", "tracker": "cross"}
_LINE_MARKS: dict[str, Mark] = {"before": "line", "right": "line", "tracker": "dash"}
#: Heights: of a plane alone, of two planes beside each other, and of points.
_ONE, _TWO, _POINTS = 300.0, 215.0, 330.0
#: Distance of two means below which a plane shows no difference, in standard deviations.
_SAME = 0.02
#: Size of an ellipse with 95 % of a Gaussian in a plane, standard deviations.
_SIZE_95 = float(np.sqrt(point95(2)))


def exhibit_figure(name: str, exhibit: Exhibit) -> Figure:
    """The figure of an exhibit; ``name`` is that of its file."""
    drawn: dict[type[Exhibit], Callable[[str, Any], Figure]] = {
        Matrices: _matrices_figure,
        Predictions: _beliefs_figure,
        Covariances: _beliefs_figure,
        OverTime: over_time_figure,
        Points: _points_figure,
    }
    return drawn[type(exhibit)](name, exhibit)


def outline(mean: Array, covariance: Array, size: float = _SIZE_95) -> Array:
    """``(2, k)`` points of an ellipse of ``size`` standard deviations; none of an indefinite covariance."""
    if not np.isfinite(covariance).all():
        return np.empty((2, 0))
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    if values[0] < 0.0:
        return np.empty((2, 0))
    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    return np.asarray(mean[:, None] + size * (vectors * np.sqrt(values)) @ np.array([np.cos(angle), np.sin(angle)]))


def _fit_equal(axes: Axes, drawn: list[Array]) -> None:
    """Equal scales and limits around all points ``(2, k)``, in as much of the box as there is."""
    points = np.concatenate(drawn, axis=1)
    points = points[:, np.isfinite(points).all(axis=0)]
    if points.size:
        low, high = points.min(axis=1), points.max(axis=1)
        half = 0.55 * max(float((high - low).max()), 1e-9)
        middle = (low + high) / 2
        axes.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 5, 10]))
    axes.set_aspect("equal", adjustable="box")


def _sigma(covariance: Array) -> float:
    return float(np.sqrt(max(0.0, float(np.trace(covariance)))))


def _beliefs_figure(name: str, exhibit: Covariances | Predictions) -> Figure:
    """The estimate before, the right one and the tracker's, with ellipses of 95 %.

    Predictions with their means, in the planes in which the tracker's and the right one differ; covariances around
    one point, in both planes.
    """
    beliefs = {"before": exhibit.before, "right": exhibit.right, "tracker": exhibit.tracker}
    drawn = {role: belief for role, belief in beliefs.items() if belief is not None}
    with_means, parts = isinstance(exhibit, Predictions), list(_PLANES)
    if with_means:
        parts = [part for part in parts if _differ(drawn["tracker"], drawn["right"], _PLANES[part])] or ["position"]

    def draw(axes: Axes, role: str, belief: StatedBelief, plane: slice) -> list[Array]:
        colour, mean = _COLOURS[role], belief.mean[plane]
        ring = outline(mean if with_means else np.zeros(2), belief.covariance[plane, plane])
        if not with_means:
            style, width = _LINES[role]
            alpha = 0.6 if role == "before" else 1.0
            axes.plot(*ring, color=colour, linestyle=style, linewidth=width, alpha=alpha, gid=f"shown-{role}")
            return [ring]
        marker, size = MARKERS[_MARKS[role]]
        axes.plot(*ring, color=colour, linewidth=1.4)
        axes.plot(
            mean[:1], mean[1:], color=colour, marker=marker, markersize=size + 1,
            markerfacecolor="none" if role == "right" else colour, markeredgewidth=1.8, linestyle="none",
            gid=f"shown-{role}",
        )  # fmt: skip
        return [mean[:, None], ring]

    def paint(canvas: Canvas) -> None:
        panels = canvas.subplots(1, len(parts), squeeze=False)[0]
        for axes, part in zip(panels, parts, strict=True):
            plane = _PLANES[part]
            axes.set(xlabel=STATE[plane][0], ylabel=STATE[plane][1])
            shapes = [shape for role, belief in drawn.items() for shape in draw(axes, role, belief, plane)]
            if with_means and "before" in drawn:
                for role in ("right", "tracker"):
                    ends = np.stack([drawn["before"].mean[plane], drawn[role].mean[plane]], axis=1)
                    axes.plot(*ends, color=_COLOURS[role], linestyle=DASHED, linewidth=1.0)
            _fit_equal(axes, shapes)

    def text(part: str) -> str:
        plane, unit = _PLANES[part], _UNITS[part]
        if not with_means:
            sigmas = [f"{belief.name} {_sigma(belief.covariance[plane, plane]):.3g}" for belief in drawn.values()]
            return f"Standard deviation of the {part}, {unit}: {'; '.join(sigmas)}."
        shown = [(drawn[role].name, drawn[role].mean[plane]) for role in ("tracker", "right")]
        # The names without what stands after a comma or colon.
        points = [f"{re.split('[,:]', name)[0]} {mean[0]:.4g}, {mean[1]:.4g} {unit}" for name, mean in shown]
        apart = float(np.hypot(*(shown[0][1] - shown[1][1])))
        return f"{part.capitalize()}: {'; '.join(points)}: {apart:.3g} {unit} apart."

    marks = _MARKS if with_means else _LINE_MARKS
    legend = tuple(LegendEntry(belief.name, _COLOURS[role], marks[role]) for role, belief in drawn.items())
    tooltips = {f"shown-{role}": belief.name for role, belief in drawn.items()}
    height = _ONE if len(parts) == 1 else _TWO
    caption = " ".join(text(part) for part in parts)
    return captioned_figure(name, exhibit.title, caption, paint, height, legend, tooltips, note=" Ellipses: 95 %.")


def _differ(tracker: StatedBelief, right: StatedBelief, plane: slice) -> bool:
    """Whether the means differ, relative to the spread of the right one."""
    apart = np.hypot(*(tracker.mean - right.mean)[plane])
    spread = np.sqrt(np.nan_to_num(np.trace(right.covariance[plane, plane])))
    return bool(not np.isfinite(apart) or apart > _SAME * max(float(spread), 1e-9))


def _points_figure(name: str, exhibit: Points) -> Figure:
    """The points, and where they have weights these too, as sizes and in the legend."""
    mine, right = exhibit.tracker_ring, exhibit.right_ring

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=exhibit.axes[0], ylabel=exhibit.axes[1])
        drawn: list[Array] = [outline(right.mean, right.covariance, right.size), exhibit.tracker]
        axes.plot(*drawn[0], color=REFERENCE, linewidth=1.6, gid="ring-right")
        if exhibit.right is not None:
            axes.plot(
                *exhibit.right, color=REFERENCE, marker="o", markersize=7.0, markerfacecolor="none",
                markeredgewidth=1.6, linestyle="none", gid="shown-right",
            )  # fmt: skip
            drawn.append(exhibit.right)
        if mine is not None:
            drawn.append(outline(mine.mean, mine.covariance, mine.size))
            axes.plot(*drawn[-1], color=TRACKER, linestyle=DASHED, linewidth=1.6, gid="ring-tracker")
        marker, size = ("x", 6.0) if exhibit.right is not None else ("o", 3.0)
        axes.plot(
            *exhibit.tracker, color=TRACKER, marker=marker, markersize=size, markeredgewidth=1.6, linestyle="none",
            gid="shown-tracker",
        )  # fmt: skip
        if mine is not None:
            for ring, colour in ((right, REFERENCE), (mine, TRACKER)):
                axes.plot(*ring.mean[:, None], color=colour, marker="+", markersize=11, markeredgewidth=1.8)
        _fit_equal(axes, drawn)

    own, other = ("", "") if exhibit.weight is None else (f", weights {w:.4g}" for w in exhibit.weight)
    entries = [LegendEntry(f"{exhibit.name}{own}", TRACKER, "dot" if exhibit.right is None else "cross")]
    if exhibit.right is not None:
        entries.append(LegendEntry(f"{exhibit.right_name}{other}", REFERENCE, "ring"))
    entries.append(LegendEntry(right.name, REFERENCE))
    if mine is not None:
        entries.append(LegendEntry(mine.name, TRACKER, "dash"))
    caption = _points_text(exhibit)
    tooltips = {"shown-tracker": exhibit.name, "shown-right": exhibit.right_name}
    return captioned_figure(name, exhibit.title, caption, paint, _POINTS, tuple(entries), tooltips)


def _points_text(exhibit: Points) -> str:
    ring, mine, count = exhibit.right_ring, exhibit.tracker_ring, exhibit.tracker.shape[1]
    if mine is None or exhibit.right is None or exhibit.weight is None:
        apart = exhibit.tracker - ring.mean[:, None]
        squared = np.einsum("ik,ij,jk->k", apart, np.linalg.inv(ring.covariance), apart)
        inside = int(np.sum(squared <= ring.size**2))
        return f"{inside} of {count} are within {ring.name}; RMS {np.sqrt(squared.mean() / 2):.3g} for each component."
    each = (exhibit.tracker, exhibit.right)
    distances = [np.hypot(*(points - points.mean(axis=1, keepdims=True))).mean() for points in each]
    means = [", ".join(f"{value:.4g}" for value in ellipse.mean) for ellipse in (mine, ring)]
    sums = [count * weight for weight in exhibit.weight]
    return (
        f"{count} points whose weights sum to {sums[0]:.4g} (right: {sums[1]:.4g}), at "
        f"{distances[0] / distances[1]:.3g} times the right distance from their mean. The mean becomes {means[0]} from "
        f"{means[1]}, the standard deviation {_sigma(mine.covariance):.3g} from {_sigma(ring.covariance):.3g}. The "
        "points are drawn here; the tracker's own are not known."
    )


#: Points: of a letter, of a row, around the numbers of a column, between two matrices, and of a bracket.
_SIZE, _ROW, _PAD, _GAP, _BRACKET = 10.0, 20.0, 8.0, 16.0, 4.0
#: Width of bold letters over that of others.
_BOLD = 1.25
#: Digits of numbers; where there are few columns there is room for more.
_DIGITS, _MORE, _FEW = 3, 5, 2
#: Entries of which the caption gives the numbers.
_SAID = 3
#: Share of the largest entry below which one is zero but for rounding.
_ROUNDING = 1e-10


class _Placed(NamedTuple):
    """A matrix on the canvas, in points from its upper left corner."""

    panel: Panel
    texts: list[list[str]]
    """Of the entries, by row."""
    top: float
    edges: list[float]
    """Of the columns, from left to right."""


def _matrices_figure(name: str, exhibit: Matrices) -> Figure:
    """The matrices with their names; marked entries are filled in a wrong matrix, and framed in the others."""
    placed = list(_places(exhibit))
    height = placed[-1].top + (len(exhibit.rows) + 2) * _ROW + 6.0

    def paint(canvas: Canvas) -> None:
        width, whole = canvas.get_size_inches() * 72
        axes = canvas.add_axes((0, 1 - height / whole, 1, height / whole), xlim=(0, width), ylim=(height, 0))
        axes.axis("off")
        for k, matrix in enumerate(placed):
            _draw_matrix(axes, exhibit, matrix, k, rows_named=matrix.edges[0] == placed[0].edges[0])

    entries = "; ".join(_entry(exhibit, i, j, exhibit.panels) for i, j in exhibit.marked[:_SAID])
    more = f"; {len(exhibit.marked) - _SAID} others" if len(exhibit.marked) > _SAID else ""
    caption = f"Marked: {entries}{more}." if entries else "No single entry stands out."
    tooltips = {
        f"marked-{k}-{i}-{j}": _entry(exhibit, i, j, [panel])
        for k, panel in enumerate(exhibit.panels)
        for i, j in exhibit.marked
    }
    return captioned_figure(name, exhibit.title, caption, paint, height, tooltips=tooltips)


def _places(exhibit: Matrices) -> Iterator[_Placed]:
    """The matrices from left to right, and below each other where there is no room."""
    begin = max(text_width(row, _SIZE) for row in exhibit.rows) + _PAD
    left, top = begin, 0.0
    for panel in exhibit.panels:
        texts = _texts(panel.values, _MORE if len(exhibit.columns) <= _FEW else _DIGITS)
        widths = [
            max(text_width(text, _SIZE) for text in (column, *(row[j] for row in texts))) + _PAD
            for j, column in enumerate(exhibit.columns)
        ]
        widths[-1] += max(0.0, _BOLD * text_width(panel.title, _SIZE) - sum(widths))
        if left > begin and left + sum(widths) > WIDTH:
            left, top = begin, top + (len(exhibit.rows) + 2) * _ROW + 0.5 * _GAP
        edges = [float(edge) for edge in left + np.cumsum([0.0, *widths])]
        yield _Placed(panel, texts, top, edges)
        left = edges[-1] + _GAP


def _texts(values: np.ndarray, digits: int) -> list[list[str]]:
    """The entries with so many digits, and as few letters as possible."""
    largest = float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))

    def number(value: float) -> str:
        mantissa, _, exponent = f"{0.0 if abs(value) < _ROUNDING * largest else value:.{digits}g}".partition("e")
        return (f"{mantissa}e{int(exponent)}" if exponent else mantissa).replace("-", "\N{MINUS SIGN}")

    return [[number(float(value)) for value in row] for row in values]


def _draw_matrix(axes: Axes, exhibit: Matrices, matrix: _Placed, k: int, *, rows_named: bool) -> None:
    colour, edges = _COLOURS[matrix.panel.role], matrix.edges
    first, last = matrix.top + 2 * _ROW, matrix.top + (2 + len(exhibit.rows)) * _ROW
    axes.text(edges[0], first - 1.5 * _ROW, matrix.panel.title, color=colour, size=_SIZE, va="center", weight="bold")
    for column, right in zip(exhibit.columns, edges[1:], strict=True):
        axes.text(right - 4, first - 0.5 * _ROW, column, color=MUTED, size=_SIZE, ha="right", va="center")
    for i, (row, texts) in enumerate(zip(exhibit.rows, matrix.texts, strict=True)):
        middle = first + (i + 0.5) * _ROW
        if rows_named:
            axes.text(2, middle, row, color=MUTED, size=_SIZE, va="center")
        for j, text in enumerate(texts):
            if (i, j) in exhibit.marked:
                width = edges[j + 1] - edges[j]
                box = Rectangle((edges[j] + 1.5, middle - 0.5 * _ROW + 1), width - 3, _ROW - 2, edgecolor=colour)
                wrong = matrix.panel.role == "tracker"
                box.set(facecolor=colour if wrong else "none", alpha=0.4 if wrong else 1.0, linewidth=1.4)
                box.set_gid(f"marked-{k}-{i}-{j}")
                axes.add_patch(box)
            axes.text(edges[j + 1] - 4, middle, text, color=INK, size=_SIZE, ha="right", va="center")
    for x, inward in ((edges[0], _BRACKET), (edges[-1], -_BRACKET)):
        axes.plot([x + inward, x, x, x + inward], [first, first, last, last], color=MUTED, linewidth=1.2)


def _entry(exhibit: Matrices, i: int, j: int, panels: Sequence[Panel]) -> str:
    """An entry in words, in each matrix."""
    where = exhibit.rows[i] if len(exhibit.columns) == 1 else f"row {exhibit.rows[i]}, column {exhibit.columns[j]}"
    return f"{where}: {' | '.join(f'{panel.title} {panel.values[i, j]:.4g}' for panel in panels)}"
