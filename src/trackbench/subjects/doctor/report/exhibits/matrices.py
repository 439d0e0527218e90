"""Matrices beside each other, with the entries that a finding names marked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Rectangle

from trackbench.document import Figure
from trackbench.document.drawing import INK, MUTED, WIDTH
from trackbench.document.margins import text_width
from trackbench.subjects.doctor.exhibits import Matrices, Panel
from trackbench.subjects.doctor.report.exhibits.roles import COLOURS

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
