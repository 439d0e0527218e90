"""A replay as data: a text, scenes seen from above, and charts over simulated time.

A recording stores all of it; an HTML page plays one scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from trackbench.base.types import Array
from trackbench.document import TrackerStyle


class ChartLine(NamedTuple):
    """Line of a chart."""

    entity: tuple[str, ...]
    """Path of the line's entity in a recording, relative to the chart's."""
    name: str
    colour: str
    time: Array
    """Time, s."""
    value: Array
    """Value at each time; NaN where it is missing."""
    width: float = 1.5
    """Width of the line, pixels."""


@dataclass(frozen=True)
class Chart:
    """Lines that share an axis."""

    place: tuple[str, ...]
    """Path of the chart's entity in a recording, relative to the entity of all charts."""
    quantity: str
    unit: str
    """Unit; empty for a quantity without one."""
    lines: tuple[ChartLine, ...]
    bounds: tuple[ChartLine, ...] = ()
    signed: bool = False
    """Whether zero is in the middle of the axis."""
    share: bool = False
    """Whether the values are shares of one; the lines are then no trackers and have a legend."""

    @property
    def title(self) -> str:
        """Quantity with its unit."""
        return f"{self.quantity}, {self.unit}" if self.unit else self.quantity

    @property
    def largest(self) -> float:
        """Largest finite value of all lines; 0 without any."""
        return float(_finite(self.lines).max(initial=0.0))

    def span(self, shown: float = 0.0) -> tuple[float, float]:
        """Return the ends of an axis that cuts off outliers, such as the start of a track or one bad tracker.

        Args:
            shown: value that the axis includes.
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
    """Entry of the legend."""

    name: str
    colour: str
    mark: Literal["line", "dot", "mark", "ring"] = "line"


@dataclass(frozen=True, eq=False)
class ReplayPath:
    """Moving point: a dot at each time, its whole path as a line, and the 95 % ellipse of its position."""

    name: str
    colour: str
    time: Array
    """Times ``(k,)``, s."""
    position: Array
    """Positions ``(2, k)`` in the fixed frame, m."""
    covariance: Array | None = None
    """Covariances ``(2, 2, k)`` of the position, m^2; None without ellipses."""
    dot: float = 4.0
    """Radius of the dot, pixels."""
    width: float = 0.75
    """Half the width of the line, pixels; narrow lines are on top."""
    tracker: str = ""
    """Tracker with this estimate or track; empty for a vehicle."""
    label: str = ""
    """Text beside an estimate in a page, such as the number of a track; a vehicle shows its name."""
    heading: Array | None = None
    """Headings ``(k,)``, rad, unwrapped; None for a point without a body."""
    size: tuple[float, float] = (0.0, 0.0)
    """Length and width of the body, m."""
    is_observer: bool = False


@dataclass(frozen=True, eq=False)
class ReplayMeasurements:
    """Positions that a sensor measured, each shown for a short time."""

    sensor: str
    colour: str
    time: Array
    """Times ``(k,)``, s."""
    position: Array
    """Positions ``(2, k)`` in the fixed frame, m."""
    covariance: Array | None = None
    """Covariances ``(2, 2, k)`` of the position, m^2; None without ellipses."""
    false: Array | None = None
    """Mask ``(k,)`` of known false alarms; None where the origins are unknown."""


class ReplayEvent(NamedTuple):
    """Event of a tracker, at a time and a place."""

    tracker: str
    kind: str
    """Kind of event: worst (the largest error), switched, lost, merged or false."""
    time_s: float
    x_m: float
    y_m: float
    text: str


class ReplayStart(NamedTuple):
    """Time and place at which a scene opens."""

    time_s: float
    path: str
    """Name of the vehicle in the middle; empty for the whole scene."""


@dataclass(frozen=True, eq=False)
class ReplayScene:
    """Scene from above, with charts beside and below it."""

    name: str
    paths: tuple[ReplayPath, ...]
    measurements: tuple[ReplayMeasurements, ...]
    x_range: tuple[float, float]
    """Left and right end of the view, m."""
    y_range: tuple[float, float]
    beside: tuple[Chart, ...] = ()
    below: tuple[Chart, ...] = ()
    lanes: tuple[Array, ...] = ()
    """Edges of the lanes, ``(2, k)`` m each."""
    trackers: tuple[TrackerStyle, ...] = ()
    """Trackers that a reader may choose."""
    shown: tuple[str, ...] = ()
    """Names of the trackers shown at first, best first."""
    events: tuple[ReplayEvent, ...] = ()
    start: ReplayStart | None = None
    """Opening; None for the first instant, with the whole scene."""


@dataclass(frozen=True, eq=False)
class Replay:
    """Scenes with a legend and a text."""

    name: str
    kind: str
    """Kind of replay; the viewer keeps one layout for all replays of a kind."""
    title: str
    """Title of the text."""
    text: str
    """Text in Markdown."""
    legend: tuple[NamedColour, ...]
    scenes: tuple[ReplayScene, ...]


def _finite(lines: tuple[ChartLine, ...] | list[ChartLine]) -> Array:
    values = np.concatenate([line.value for line in lines]) if lines else np.empty(0)
    return np.asarray(values[np.isfinite(values)], dtype=float)
