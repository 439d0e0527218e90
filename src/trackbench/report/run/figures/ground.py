"""What a map shows under what is drawn on it: roads, paths of the vehicles, and how large it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes

from trackbench.base.types import Array
from trackbench.document.drawing import GRID, INK, MUTED
from trackbench.document.margins import shortened
from trackbench.report.run.figures.lines import column, where

#: A scene longer than this many times its width (a straight road) is drawn stretched across.
ELONGATED = 4.0
MARGIN_M = 6.0
#: Points.
TALLEST, STRETCHED = 400.0, 150.0
#: The widest name of an object, points.
NAME = 90.0
#: Of a letter and a line of a name, and where a name may stand above the end of its path, points.
LETTER, LINE = 5.2, 10.0
ABOVE = (3.0, -11.0, 14.0, -22.0, 25.0)


@dataclass(frozen=True)
class MapBox:
    """What the map shows, m."""

    left: float
    right: float
    bottom: float
    top: float

    @property
    def width(self) -> float:
        """m."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """m."""
        return self.top - self.bottom

    @property
    def stretched(self) -> bool:
        """Whether its axes have different scales."""
        return self.width > ELONGATED * self.height

    def drawn_height(self, across: float) -> float:
        """Points of a map that is so many points wide."""
        return STRETCHED if self.stretched else min(TALLEST, 30 + (across - 50) * self.height / self.width)

    def points(self, across: float) -> tuple[float, float]:
        """Of one metre in x and in y, on a map that is so many points wide."""
        return (across - 50) / self.width, (self.drawn_height(across) - 30) / self.height


def draw_surroundings(
    axes: Axes,
    roads: pa.Table,
    observer: Sequence[tuple[Array, Array]],
    targets: Mapping[str, tuple[Array, Array]],
    points: tuple[float, float],
) -> None:
    """Roads, the observer's path and those of the objects, with their names; ``points`` are of a metre in x and y."""
    lines, x, y = (column(roads, name) for name in ("line", "x_m", "y_m"))
    for line in np.unique(lines):
        axes.plot(x[lines == line], y[lines == line], color=GRID, linewidth=1.5)
    for x, y in observer:
        axes.plot(x, y, color=MUTED, linewidth=1.4, linestyle=(0, (1.5, 1.5)))
        axes.plot(x[:1], y[:1], color=MUTED, marker="s", markersize=5)
    placed: list[tuple[float, float, float]] = []
    for name, (x, y) in targets.items():
        axes.plot(x, y, color=MUTED, linewidth=0.8)
        axes.plot(x[:1], y[:1], color=INK, marker="o", markersize=3.5)
        text = shortened(name, NAME, 9)
        left, at, width = x[-1] * points[0] + 3, y[-1] * points[1], LETTER * len(text)
        above = next((each for each in ABOVE if _free(left, at + each, width, placed)), ABOVE[0])
        placed.append((left, at + above, width))
        axes.annotate(text, (x[-1], y[-1]), xytext=(3, above), textcoords="offset points", fontsize=9)


def _free(left: float, bottom: float, width: float, placed: Sequence[tuple[float, float, float]]) -> bool:
    """Whether a name covers none of those that are there."""
    return all(
        abs(bottom - other) >= LINE or left >= start + wide or start >= left + width for start, other, wide in placed
    )


def alive_path(truth: pa.Table, name: str) -> tuple[Array, Array]:
    """``(points,)`` x and y of an object while it is there, m."""
    rows = where(truth, object=name)
    alive = column(rows, "alive") > 0
    return column(rows, "px_m")[alive], column(rows, "py_m")[alive]


def box_around(paths: Sequence[tuple[Array, Array]]) -> MapBox | None:
    """What holds all paths; None where there is none."""
    x = np.concatenate([path[0] for path in paths]) if paths else np.empty(0)
    y = np.concatenate([path[1] for path in paths]) if paths else np.empty(0)
    if not x.size:
        return None
    return MapBox(x.min() - MARGIN_M, x.max() + MARGIN_M, y.min() - MARGIN_M, y.max() + MARGIN_M)
