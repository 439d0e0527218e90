"""Figures of numbers: courses over time, and matrices; and the colours of their roles."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator, MaxNLocator

from trackbench.base.types import Array, Mask
from trackbench.document import Figure, LegendEntry
from trackbench.document.drawing import INK, MUTED, WIDTH, fit_value_axis
from trackbench.document.margins import text_width
from trackbench.document.palette import TRACKER_COLOURS
from trackbench.metrics.consistency import point95
from trackbench.subjects.doctor.exhibits import Course, Matrices, OverTime, Panel

TRACKER, REFERENCE = TRACKER_COLOURS[4], TRACKER_COLOURS[5]
COLOURS = {"tracker": TRACKER, "right": REFERENCE, "before": MUTED}
#: Size of an ellipse with 95 % of a Gaussian in a plane, standard deviations.
SIZE = float(np.sqrt(point95(2)))
_POINTS = 73
#: An axis that spans more than this factor has room for powers of ten alone.
_MANY = 3e3


def outline(mean: Array, covariance: Array, size: float = SIZE) -> Array:
    """``(2, k)`` points of an ellipse of ``size`` standard deviations; none of an indefinite covariance."""
    if not np.isfinite(covariance).all():
        return np.empty((2, 0))
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    if values[0] < 0.0:
        return np.empty((2, 0))
    angle = np.linspace(0.0, 2.0 * np.pi, _POINTS)
    return np.asarray(mean[:, None] + size * (vectors * np.sqrt(values)) @ np.array([np.cos(angle), np.sin(angle)]))


def fit_values(axes: Axes, drawn: Sequence[Array]) -> bool:
    """As :func:`fit_value_axis`, with room between the numbers also of many powers of ten."""
    logarithmic = fit_value_axis(axes, drawn)
    low, high = axes.get_ylim()
    if logarithmic and high > _MANY * low:
        axes.yaxis.set_major_locator(LogLocator(numticks=7))
    return logarithmic


def fit_equal(axes: Axes, drawn: list[Array]) -> None:
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


_PANEL, _LEAST = 170.0, 230.0
#: So few values are drawn as points too.
_FEW = 5
#: Of more time than this only so much is drawn, s.
_LONG = 20.0
#: Share of what is right below which a value is next to nothing.
_NOTHING = 1e-3


def over_time_figure(name: str, of: OverTime) -> Figure:
    """A panel for each quantity, with the same time."""

    def paint(canvas: Canvas) -> None:
        panels = canvas.subplots(len(of.courses), 1, sharex=True, squeeze=False)[:, 0]
        for axes, course in zip(panels, of.courses, strict=True):
            if of.marked is not None:
                axes.axvspan(*of.marked, color=TRACKER, alpha=0.25, gid="marked")
            if course.band is not None:
                axes.fill_between(of.at, *course.band, color=MUTED, alpha=0.35, linewidth=0, gid="band")
            marker = "o" if len(of.at) <= _FEW else None
            if course.right is not None:
                axes.plot(of.at, course.right, color=REFERENCE, marker=marker, gid="shown-right")
            axes.plot(of.at, course.tracker, color=TRACKER, marker=marker, gid="shown-tracker")
            axes.set_ylabel(course.label)
            _fit(axes, course)
            axes.set_xlim(*_span(of))
            axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
        panels[-1].set_xlabel(of.axis)

    said = " ".join(_numbers(of, course) for course in of.courses)
    bands = {course.band_name for course in of.courses if course.band is not None}
    entries = [LegendEntry("tracker", TRACKER)]
    if any(course.right is not None for course in of.courses):
        entries.append(LegendEntry(of.right_name, REFERENCE))
    entries += [LegendEntry(band, MUTED, "band") for band in sorted(bands)]
    tooltips = {"shown-tracker": "tracker", "shown-right": of.right_name}
    if of.marked is not None:
        entries.append(LegendEntry(f"{of.marked[0]:g} to {of.marked[1]:g} s", TRACKER, "band"))
        tooltips["marked"] = f"{of.marked[0]:g} to {of.marked[1]:g} s"
    height = max(_LEAST, _PANEL * len(of.courses))
    return Figure(name, of.title, said, f"{of.title}. {said}", paint, height, legend=tuple(entries), tooltips=tooltips)


def _span(of: OverTime) -> tuple[float, float]:
    """All of the time, or where that is long what is around the marked interval."""
    begin, end = min(0.0, float(of.at.min())), float(of.at.max())
    if of.marked is None or end - begin < _LONG:
        return begin, end
    middle = float(np.clip(sum(of.marked) / 2, begin + _LONG / 2, end - _LONG / 2))
    return middle - _LONG / 2, max(middle + _LONG / 2, of.marked[1])


def _fit(axes: Axes, course: Course) -> None:
    """Limits around all; with zero on the axis where the tracker's values are next to nothing."""
    others = [] if course.right is None else [course.right]
    others += [] if course.band is None else [course.band[1]]
    largest = max((float(np.nanmax(one)) for one in others), default=0.0)
    if largest > 0.0 and not (course.tracker > _NOTHING * largest).any():
        axes.set_ylim(-0.05 * largest, 1.06 * largest)
    else:
        fit_values(axes, [course.tracker, *others])


def _numbers(of: OverTime, course: Course) -> str:
    """The means of the marked interval, or the values at both ends."""
    unit = of.axis.rpartition(", ")[2]
    if of.marked is None:
        ends = (0, len(of.at) - 1)
        said = "; ".join(f"at {of.at[k]:.3g} {unit} {_said(of, course, np.arange(len(of.at)) == k)}" for k in ends)
    else:
        within = (of.at >= of.marked[0]) & (of.at < of.marked[1])
        said = f"mean from {of.marked[0]:g} to {of.marked[1]:g} {unit} {_said(of, course, within)}"
    return f"{course.label[0].upper()}{course.label[1:]}: {said}."


def _said(of: OverTime, course: Course, chosen: Mask) -> str:
    numbers = [f"tracker {_mean(course.tracker, chosen):.3g}"]
    if course.right is not None:
        numbers.append(f"{of.right_name} {_mean(course.right, chosen):.3g}")
    if course.band is not None:
        numbers.append(f"band {_mean(course.band[0], chosen):.3g} to {_mean(course.band[1], chosen):.3g}")
    return ", ".join(numbers)


def _mean(values: Array, chosen: Mask) -> float:
    known = values[chosen & np.isfinite(values)]
    return float(known.mean()) if known.size else np.nan


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
    left: float
    top: float
    edges: list[float]
    """Of the columns, from left to right."""
    named: bool
    """Whether the names of the rows stand to its left."""


def matrices_figure(name: str, of: Matrices) -> Figure:
    """The matrices with their names; marked entries are filled in a wrong matrix, and framed in the others."""
    placed = list(_places(of))
    height = placed[-1].top + (len(of.rows) + 2) * _ROW + 6.0

    def paint(canvas: Canvas) -> None:
        width, whole = canvas.get_size_inches() * 72
        axes = canvas.add_axes((0, 1 - height / whole, 1, height / whole), xlim=(0, width), ylim=(height, 0))
        axes.axis("off")
        for k, one in enumerate(placed):
            _draw(axes, of, one, k)

    said = "; ".join(_entry(of, i, j, of.panels) for i, j in of.marked[:_SAID])
    said = f"Marked: {said}{'; ...' if len(of.marked) > _SAID else ''}." if said else "No single entry stands out."
    tooltips = {_gid(k, i, j): _entry(of, i, j, [one]) for k, one in enumerate(of.panels) for i, j in of.marked}
    return Figure(name, of.title, said, f"{of.title}. {said}", paint, height, tooltips=tooltips)


def _places(of: Matrices) -> Iterator[_Placed]:
    """The matrices from left to right, and below each other where there is no room."""
    begin = max(text_width(row, _SIZE) for row in of.rows) + _PAD
    left, top = begin, 0.0
    for panel in of.panels:
        texts = _texts(panel.values, _MORE if len(of.columns) <= _FEW else _DIGITS)
        widths = [
            max(text_width(text, _SIZE) for text in (column, *(row[j] for row in texts))) + _PAD
            for j, column in enumerate(of.columns)
        ]
        widths[-1] += max(0.0, _BOLD * text_width(panel.title, _SIZE) - sum(widths))
        if left > begin and left + sum(widths) > WIDTH:
            left, top = begin, top + (len(of.rows) + 2) * _ROW + 0.5 * _GAP
        edges = [float(edge) for edge in left + np.cumsum([0.0, *widths])]
        yield _Placed(panel, texts, left, top, edges, left == begin)
        left = edges[-1] + _GAP


def _texts(values: np.ndarray, digits: int) -> list[list[str]]:
    largest = float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))
    return [
        [_number(float(value) if not abs(value) < _ROUNDING * largest else 0.0, digits) for value in row]
        for row in values
    ]


def _number(value: float, digits: int) -> str:
    """With so many digits, and as few letters as possible."""
    mantissa, _, exponent = f"{value:.{digits}g}".partition("e")
    return (f"{mantissa}e{int(exponent)}" if exponent else mantissa).replace("-", "\N{MINUS SIGN}")


def _draw(axes: Axes, of: Matrices, one: _Placed, k: int) -> None:
    colour, edges = COLOURS[one.panel.role], one.edges
    first, last = one.top + 2 * _ROW, one.top + (2 + len(of.rows)) * _ROW
    axes.text(one.left, one.top + 0.5 * _ROW, one.panel.title, color=colour, size=_SIZE, va="center", weight="bold")
    for column, right in zip(of.columns, edges[1:], strict=True):
        axes.text(right - 4, one.top + 1.5 * _ROW, column, color=MUTED, size=_SIZE, ha="right", va="center")
    for i, (row, texts) in enumerate(zip(of.rows, one.texts, strict=True)):
        middle = first + (i + 0.5) * _ROW
        if one.named:
            axes.text(2, middle, row, color=MUTED, size=_SIZE, va="center")
        for j, text in enumerate(texts):
            if (i, j) in of.marked:
                width = edges[j + 1] - edges[j]
                box = Rectangle((edges[j] + 1.5, middle - 0.5 * _ROW + 1), width - 3, _ROW - 2, edgecolor=colour)
                wrong = one.panel.role == "tracker"
                box.set(facecolor=colour if wrong else "none", alpha=0.4 if wrong else 1.0, linewidth=1.4)
                box.set_gid(_gid(k, i, j))
                axes.add_patch(box)
            axes.text(edges[j + 1] - 4, middle, text, color=INK, size=_SIZE, ha="right", va="center")
    for x, inward in ((edges[0], _BRACKET), (edges[-1], -_BRACKET)):
        axes.plot([x + inward, x, x, x + inward], [first, first, last, last], color=MUTED, linewidth=1.2)


def _gid(k: int, i: int, j: int) -> str:
    """Of the mark of an entry of the k-th matrix."""
    return f"marked-{k}-{i}-{j}"


def _entry(of: Matrices, i: int, j: int, panels: Sequence[Panel]) -> str:
    """An entry in words, in each matrix."""
    where = of.rows[i] if len(of.columns) == 1 else f"row {of.rows[i]}, column {of.columns[j]}"
    return f"{where}: {' | '.join(f'{panel.title} {panel.values[i, j]:.4g}' for panel in panels)}"
