"""Rows and columns of a result's tables, as arrays. A table is empty where every tracker failed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from matplotlib.axes import Axes

from trackbench.base.types import Array
from trackbench.document import TrackerStyle
from trackbench.document.drawing import time_axis


def where(table: pa.Table, **keys: str) -> pa.Table:
    """The rows of ``table`` whose columns equal ``keys``."""
    for name, value in keys.items():
        if name in table.column_names:
            table = table.filter(pc.equal(table[name], value))
    return table


def column(table: pa.Table, name: str) -> Array:
    """A column as floats, NaN where it is null; nothing where the table lacks it."""
    if name not in table.column_names:
        return np.empty(0)
    values: Array = table[name].to_numpy().astype(np.float64)
    return values


def names(table: pa.Table, name: str) -> list[str]:
    """The different values of a column of text, in the order in which they come."""
    return [] if name not in table.column_names else table[name].unique().to_pylist()


#: Errors are averaged over time to about so many points, or a sensor that alternates with another fills the figure.
_POINTS = 100


class Line(NamedTuple):
    """What is drawn of one tracker."""

    style: TrackerStyle
    time: Array
    """s"""
    value: Array


def lines(table: pa.Table, styles: Sequence[TrackerStyle], name: str) -> list[Line]:
    """The column ``name`` of each tracker that has values in it."""
    found = []
    for style in styles:
        rows = where(table, tracker=style.name)
        value = column(rows, name)
        if np.isfinite(value).any():
            found.append(Line(style, column(rows, "time_s"), value))
    return found


def smooth_lines(table: pa.Table, styles: Sequence[TrackerStyle], name: str) -> list[Line]:
    """The same as root mean squares over equal stretches of time."""
    return [Line(line.style, *_stretches(line.time, line.value)) for line in lines(table, styles, name)]


def draw_lines(axes: Axes, drawn: Sequence[Line], end: float) -> None:
    """The best tracker on top, from 0 to ``end`` s."""
    for style, time, value in reversed(drawn):
        axes.plot(time, value, color=style.colour, linestyle=style.line, gid=style.key)
    time_axis(axes, end)


def end_of(table: pa.Table) -> float:
    """The last time of a table, s."""
    return float(column(table, "time_s").max())


def styles_of(drawn: Iterable[Line]) -> list[TrackerStyle]:
    """Whose lines they are."""
    return [line.style for line in drawn]


def last_values(drawn: Sequence[Line], unit: str) -> str:
    """The last value of each line, for those who cannot see it."""
    last = [(line.style.name, line.value[np.isfinite(line.value)][-1]) for line in drawn]
    return "At the end: " + ", ".join(f"{name} {value:.3g} {unit}".strip() for name, value in last) + "."


def _stretches(time: Array, value: Array) -> tuple[Array, Array]:
    size = max(1, round(len(time) / _POINTS))
    starts = np.arange(0, len(time) - size + 1, size)
    known = np.isfinite(value)
    count = np.add.reduceat(known.astype(float), starts)
    square = np.add.reduceat(np.where(known, value, 0.0) ** 2, starts)
    steps = np.add.reduceat(np.ones(len(time)), starts)
    return np.add.reduceat(time, starts) / steps, np.sqrt(square / np.where(count > 0, count, np.nan))
