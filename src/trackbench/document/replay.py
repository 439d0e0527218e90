"""A replay as data: texts, scenes seen from above, charts over simulated time.

The recording writes it to a file; a page plays a scene of it on a canvas.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from trackbench.base.types import Array
from trackbench.document import TrackerStyle


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


class NamedColour(NamedTuple):
    """An entry of the legend: a colour and what has it."""

    name: str
    colour: str
    mark: Literal["line", "dot", "mark", "ring"] = "line"


@dataclass(frozen=True, eq=False)
class ReplayPath:
    """A point that moves: a dot at each time, its whole path as a line, and the 95 % ellipse of its position."""

    name: str
    colour: str
    time: Array
    """``(k,)`` s."""
    position: Array
    """``(2, k)`` m in the fixed frame."""
    covariance: Array | None = None
    """``(2, 2, k)`` m^2; None without ellipses."""
    dot: float = 4.0
    """Radius of the dot, pixels."""
    width: float = 0.75
    """Half the width of the line, pixels; narrow lines are on top."""
    tracker: str = ""
    """The tracker whose estimate or track it is; empty of a vehicle."""
    label: str = ""
    """What a page writes beside an estimate, such as the number of a track; beside a vehicle it writes the name."""
    heading: Array | None = None
    """``(k,)`` rad, continuous; None of what has no body."""
    size: tuple[float, float] = (0.0, 0.0)
    """Length and width of the body, m."""


@dataclass(frozen=True, eq=False)
class ReplayMeasurements:
    """The positions that a sensor measured, each shown for a while."""

    sensor: str
    colour: str
    time: Array
    """``(k,)`` s."""
    position: Array
    """``(2, k)`` m in the fixed frame."""
    covariance: Array | None = None
    """``(2, 2, k)`` m^2; None without ellipses."""
    false: Array | None = None
    """``(k,)`` whether it is known to be a false alarm; None where nothing is known."""


class ReplayEvent(NamedTuple):
    """What happened to a tracker at a place."""

    tracker: str
    kind: str
    """worst (the largest error), switched, lost, merged or false."""
    time_s: float
    x_m: float
    y_m: float
    text: str


class ReplayStart(NamedTuple):
    """When and where a scene opens."""

    time_s: float
    path: str
    """The name of the vehicle in the middle; empty: the whole scene."""


@dataclass(frozen=True, eq=False)
class ReplayScene:
    """A scene from above with charts beside it and below it."""

    name: str
    paths: tuple[ReplayPath, ...]
    measurements: tuple[ReplayMeasurements, ...]
    x_range: tuple[float, float]
    """m, what the view shows."""
    y_range: tuple[float, float]
    beside: tuple[Chart, ...] = ()
    below: tuple[Chart, ...] = ()
    lanes: tuple[Array, ...] = ()
    """``(2, k)`` m, the edges of the lanes."""
    trackers: tuple[TrackerStyle, ...] = ()
    """Those that a reader may choose."""
    shown: tuple[str, ...] = ()
    """The names of the trackers that are shown at first, best first."""
    events: tuple[ReplayEvent, ...] = ()
    start: ReplayStart | None = None
    """None: at the beginning, with the whole scene."""


@dataclass(frozen=True, eq=False)
class Replay:
    """Scenes with a legend and a text."""

    name: str
    kind: str
    """The viewer keeps one layout for all replays of a kind."""
    title: str
    """Of the text."""
    text: str
    """Markdown."""
    legend: tuple[NamedColour, ...]
    scenes: tuple[ReplayScene, ...]


def _finite(lines: tuple[ChartLine, ...] | list[ChartLine]) -> Array:
    values = np.concatenate([line.value for line in lines]) if lines else np.empty(0)
    return np.asarray(values[np.isfinite(values)], dtype=float)
