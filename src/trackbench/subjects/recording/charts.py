"""A chart of one quantity over time: a line for each tracker, and the bounds that they are held against."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array
from trackbench.subjects.recording.shapes import send_line
from trackbench.subjects.recording.stream import Stream, path

SERIES = "series"
#: Rerun 0.41 has no logarithmic axis, so what spans orders of magnitude is also there as decimal logarithms.
LOG10 = "log10"
#: Values that differ by more than this factor, but for the smallest tenth, span a large range.
LARGE = 15.0


class ChartLine(NamedTuple):
    """One line of a chart."""

    entity: tuple[str, ...]
    """Below the chart's own."""
    name: str
    colour: str
    time: Array
    """s"""
    value: Array
    """NaN where there is none."""
    width: float = 1.5
    """Pixels."""


@dataclass(frozen=True)
class Chart:
    """Lines that share an axis."""

    place: tuple[str, ...]
    """Its entity, below that of all series."""
    quantity: str
    unit: str
    """Empty for a number without a unit."""
    lines: tuple[ChartLine, ...]
    bounds: tuple[ChartLine, ...] = ()
    signed: bool = False
    """Whether zero is in the middle of its axis."""
    share: bool = False
    """Whether the values are shares of one; its lines then have a legend, being no trackers."""

    @property
    def title(self) -> str:
        """The quantity with its unit."""
        return f"{self.quantity}, {self.unit}" if self.unit else self.quantity

    @property
    def log_title(self) -> str:
        """That of the same values as decimal logarithms."""
        return f"log10 of {self.title[0].lower() if self.unit else self.title[0]}{self.title[1:]}"

    @property
    def origin(self) -> str:
        """The entity of the values."""
        return path(SERIES, *self.place)

    @property
    def log_origin(self) -> str:
        """The entity of their decimal logarithms."""
        return path(SERIES, LOG10, *self.place)

    @cached_property
    def large(self) -> bool:
        """Whether the values span too large a range for one axis."""
        values = _finite(self.lines)
        values = values[values > 0]
        if self.signed or self.share:
            return False
        return bool(len(values) and values.max() > LARGE * np.quantile(values, 0.1))

    @property
    def largest(self) -> float:
        """The largest value of a line, 0 where there is none."""
        return float(_finite(self.lines).max(initial=0.0))

    def span(self, shown: float = 0.0) -> tuple[float, float]:
        """An axis on which neither the start of a track nor one bad tracker flattens everything else.

        Args:
            shown: a value that must be seen.
        """
        if self.share:
            return 0.0, 1.0
        if self.signed:
            values = np.abs(_finite((*self.lines, *self.bounds)))
            side = 1.2 * float(np.quantile(values, 0.99)) if len(values) else 1.0
            return -side, side
        return 0.0, max(self._top(), 1.15 * shown) or 1.0

    def _top(self) -> float:
        values, limits = _finite(self.lines), _finite(self.bounds)
        top = 1.2 * float(np.percentile(values, 97)) if len(values) else 1.0
        if self.unit == "" and len(limits):
            limit = max(float(np.median(_finite([bound]))) for bound in self.bounds)
            top = float(np.clip(top, 1.5 * limit, 4.0 * limit))
        return top


def send_chart(stream: Stream, chart: Chart) -> None:
    """The values, and their logarithms where the range is large."""
    for line in (*chart.lines, *chart.bounds):
        entity = path(SERIES, *chart.place, *line.entity)
        send_line(stream, entity, line.time, line.value, line.name, line.colour, line.width)
        if chart.large:
            logarithm = np.log10(np.where(line.value > 0, line.value, np.nan))
            entity = path(SERIES, LOG10, *chart.place, *line.entity)
            send_line(stream, entity, line.time, logarithm, line.name, line.colour, line.width)


def _finite(lines: tuple[ChartLine, ...] | list[ChartLine]) -> Array:
    values = np.concatenate([line.value for line in lines]) if lines else np.empty(0)
    return np.asarray(values[np.isfinite(values)], dtype=float)
