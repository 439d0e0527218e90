"""Matrices beside each other, with the entries that a finding names marked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Rectangle

from trackbench.doctor.exhibits import Matrices, Panel
from trackbench.document import Figure
from trackbench.document.drawing import INK, MUTED, WIDTH
from trackbench.document.margins import text_width
from trackbench.report.examination.exhibits.roles import COLOURS

#: Points: of a letter, of a row, around the numbers of a column, and between two matrices.
_SIZE, _ROW, _PAD, _GAP = 10.0, 20.0, 6.0, 16.0
#: Of the bracket beside a matrix, points.
_BRACKET = 4.0
#: Digits of numbers: where there are few columns there is room for more.
_DIGITS, _MORE, _FEW = 3, 5, 2
#: Entries of which the caption gives the numbers.
_SAID = 3


class _Placed(NamedTuple):
    """A matrix on the canvas, in points from its upper left corner."""

    panel: Panel
    left: float
    top: float
    widths: list[float]
    """Of the columns."""


def matrices_figure(name: str, of: Matrices) -> Figure:
    """The matrices with the names of rows and columns; those marked are filled where they are wrong, framed elsewhere."""
    digits = _MORE if len(of.columns) <= _FEW else _DIGITS
    labels = max(text_width(row, _SIZE) for row in of.rows) + _PAD
    placed = list(_places(of, labels, digits))
    height = placed[-1].top + (len(of.rows) + 2) * _ROW + 6

    def paint(canvas: Canvas) -> None:
        width = canvas.get_figwidth() * 72
        axes = canvas.add_axes(
            (0, 1 - height / (canvas.get_figheight() * 72), 1, height / (canvas.get_figheight() * 72))
        )
        axes.set(xlim=(0, width), ylim=(height, 0))
        axes.axis("off")
        for number, one in enumerate(placed):
            _draw(axes, of, one, number, digits)

    tooltips = {
        f"marked-{number}-{i}-{j}": _entry(of, i, j, [one.panel])
        for number, one in enumerate(placed)
        for i, j in of.marked
    }
    said = "; ".join(_entry(of, i, j, of.panels) for i, j in of.marked[:_SAID])
    more = "; ..." if len(of.marked) > _SAID else ""
    said = f"Marked: {said}{more}." if said else "No single entry is wrong."
    return Figure(name, of.title, said, f"{of.title}. {said}", paint, height, tooltips=tooltips)


def _places(of: Matrices, labels: float, digits: int) -> Iterator[_Placed]:
    """The matrices from left to right, and below each other where there is no room."""
    left, top = labels, 0.0
    for panel in of.panels:
        widths = [
            max(text_width(text, _SIZE) for text in (of.columns[j], *(number(v, digits) for v in panel.values[:, j])))
            + _PAD
            for j in range(len(of.columns))
        ]
        missing = text_width(panel.title, _SIZE) - sum(widths)
        widths[-1] += max(0.0, missing)
        if left > labels and left + sum(widths) > WIDTH:
            left, top = labels, top + (len(of.rows) + 2) * _ROW + _GAP / 2
        yield _Placed(panel, left, top, widths)
        left += sum(widths) + _GAP


def _draw(axes: Axes, of: Matrices, one: _Placed, number_of: int, digits: int) -> None:
    panel, left, top = one.panel, one.left, one.top
    right = left + sum(one.widths)
    first, last = top + 2 * _ROW, top + (2 + len(of.rows)) * _ROW
    axes.text(
        left + 2, top + 0.5 * _ROW, panel.title, color=COLOURS[panel.role], size=_SIZE, va="center", weight="bold"
    )
    edges = left + np.cumsum([0.0, *one.widths])
    for j, column in enumerate(of.columns):
        axes.text(edges[j + 1] - 3, top + 1.5 * _ROW, column, color=MUTED, size=_SIZE, ha="right", va="center")
    for i, row in enumerate(of.rows):
        middle = first + (i + 0.5) * _ROW
        if one.left <= _first_left(of):
            axes.text(2, middle, row, color=MUTED, size=_SIZE, va="center")
        for j in range(len(of.columns)):
            if (i, j) in of.marked:
                _mark(
                    axes,
                    panel,
                    (edges[j] + 1, first + i * _ROW + 1),
                    (one.widths[j] - 2, _ROW - 2),
                    f"marked-{number_of}-{i}-{j}",
                )
            text = number(float(panel.values[i, j]), digits)
            axes.text(edges[j + 1] - 3, middle, text, color=INK, size=_SIZE, ha="right", va="center")
    for x, inward in ((left, _BRACKET), (right, -_BRACKET)):
        axes.plot([x + inward, x, x, x + inward], [first, first, last, last], color=MUTED, linewidth=1.2)


def _first_left(of: Matrices) -> float:
    return max(text_width(row, _SIZE) for row in of.rows) + _PAD


def _mark(axes: Axes, panel: Panel, corner: tuple[float, float], size: tuple[float, float], gid: str) -> None:
    filled = panel.role == "tracker"
    colour = COLOURS[panel.role]
    box = Rectangle(corner, *size, facecolor=colour if filled else "none", edgecolor=colour, linewidth=1.4)
    box.set(alpha=0.35 if filled else 1.0, gid=gid)
    axes.add_patch(box)


def _entry(of: Matrices, i: int, j: int, panels: Sequence[Panel]) -> str:
    """The value of an entry in words, in each matrix."""
    where = of.rows[i] if len(of.columns) == 1 else f"row {of.rows[i]}, column {of.columns[j]}"
    return f"{where}: {' | '.join(f'{panel.title} {panel.values[i, j]:.4g}' for panel in panels)}"


def number(value: float, digits: int) -> str:
    """With so many digits, and as few letters as possible."""
    if np.isnan(value):
        return "nan"
    mantissa, _, exponent = f"{value:.{digits}g}".partition("e")
    return (f"{mantissa}e{int(exponent)}" if exponent else mantissa).replace("-", "\N{MINUS SIGN}")
