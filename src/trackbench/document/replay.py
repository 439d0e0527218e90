"""A replay as data: a text, scenes seen from above, and charts over simulated time.

A Rerun recording stores the text, scenes and charts; an HTML page plays one scene.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackbench.base.types import Array
from trackbench.document import LegendEntry, TrackerStyle


class ChartLine(NamedTuple):
    """Line in a chart: times, values, name, colour and width."""

    entity: tuple[str, ...]
    """Path of the line in a Rerun recording, below the path of the chart."""
    name: str
    colour: str
    time: Array
    """Time of each value, s."""
    value: Array
    """Value at each time; NaN where it is missing."""
    width: float = 1.5
    """Width of the line, pixels."""


@dataclass(frozen=True)
class Chart:
    """Chart of one quantity over time: lines that share an axis, with bounds."""

    place: tuple[str, ...]
    """Path of the chart in a Rerun recording, below the path of all charts."""
    quantity: str
    unit: str
    """Unit of the quantity; empty if it has none."""
    lines: tuple[ChartLine, ...]
    bounds: tuple[ChartLine, ...] = ()
    signed: bool = False
    """Whether values can be negative, so that zero is in the middle of the axis."""
    share: bool = False
    """Whether the values are shares of one, such as mode probabilities; the lines then have a legend."""

    @property
    def title(self) -> str:
        """Title of the axis: name of the quantity with its unit, as "position error, m"."""
        return f"{self.quantity}, {self.unit}" if self.unit else self.quantity

    @property
    def largest(self) -> float:
        """Largest finite value of all lines; 0 if no value is positive."""
        return float(_finite(self.lines).max(initial=0.0))

    def span(self, shown: float = 0.0) -> tuple[float, float]:
        """Return the lower and upper end of the value axis, which cuts off outliers such as the start of a track.

        Args:
            shown: value that the axis of a quantity that is neither signed nor a share must include.
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


@dataclass(frozen=True, eq=False)
class ReplayPath:
    """Moving point: a dot at each time, its whole path as a line, and the 95 % ellipse of its position."""

    name: str
    colour: str
    time: Array
    """Time of each position, ``(k,)`` s."""
    position: Array
    """Positions ``(2, k)`` in the fixed frame, m."""
    covariance: Array | None = None
    """Covariances ``(2, 2, k)`` of the positions, m^2; None to draw no ellipses."""
    dot: float = 4.0
    """Radius of the dot, pixels."""
    width: float = 0.75
    """Half the width of the line, pixels; narrow lines are drawn over wide ones."""
    tracker: str = ""
    """Name of the tracker whose estimate or track this is; empty for a vehicle."""
    label: str = ""
    """Text beside an estimate in a page, such as the number of a track; a vehicle shows its name."""
    heading: Array | None = None
    """Headings ``(k,)``, rad, unwrapped; None for a point without length and width."""
    size: tuple[float, float] = (0.0, 0.0)
    """Length and width of the body, m."""
    is_observer: bool = False


@dataclass(frozen=True, eq=False)
class ReplayMeasurements:
    """Measured positions of one sensor, each shown for a short time."""

    sensor: str
    colour: str
    time: Array
    """Time of each measurement, ``(k,)`` s."""
    position: Array
    """Positions ``(2, k)`` in the fixed frame, m."""
    covariance: Array | None = None
    """Covariances ``(2, 2, k)`` of the positions, m^2; None to draw no ellipses."""
    false: Array | None = None
    """Whether each measurement is a false alarm, ``(k,)``; None if the origins are unknown."""


class ReplayEvent(NamedTuple):
    """Notable moment of a tracker, with time and position: its largest error, or a failure such as a lost track."""

    tracker: str
    kind: str
    """Kind of event: worst (the largest error), switched, lost, merged or false."""
    time_s: float
    x_m: float
    y_m: float
    text: str


class ReplayStart(NamedTuple):
    """Time and vehicle that a scene shows when it opens."""

    time_s: float
    path: str
    """Name of the vehicle in the middle; empty for the whole scene."""


@dataclass(frozen=True, eq=False)
class ReplayScene:
    """Scene seen from above: paths, measurements, lanes and events, with charts beside and below."""

    name: str
    paths: tuple[ReplayPath, ...]
    measurements: tuple[ReplayMeasurements, ...]
    x_range: tuple[float, float]
    """Left and right end of the view, m."""
    y_range: tuple[float, float]
    beside: tuple[Chart, ...] = ()
    below: tuple[Chart, ...] = ()
    lanes: tuple[Array, ...] = ()
    """Edges of road lanes, each a line through points ``(2, k)`` in the fixed frame, m."""
    trackers: tuple[TrackerStyle, ...] = ()
    """Styles of the trackers that a reader can choose to display."""
    shown: tuple[str, ...] = ()
    """Names of the trackers that are displayed at first, best first."""
    events: tuple[ReplayEvent, ...] = ()
    start: ReplayStart | None = None
    """Time and vehicle that the scene displays first; None for the first instant and the whole scene."""


@dataclass(frozen=True, eq=False)
class Replay:
    """One or more scenes with a legend and a text, as a recording stores them."""

    name: str
    kind: str
    """Type of replay, such as "run"; the Rerun viewer uses one layout for all replays of a type."""
    title: str
    """Title of ``text``."""
    text: str
    """Text in Markdown that is shown beside the scenes, such as the findings of an examination."""
    legend: tuple[LegendEntry, ...]
    scenes: tuple[ReplayScene, ...]


#: Margin of a view around its paths, m.
MARGIN_M = 6.0
Extent = tuple[tuple[float, float], tuple[float, float]]


def extent_of(paths: Iterable[ReplayPath]) -> Extent:
    """Return the ranges of x and y, m, of a view from above that holds all paths with a margin around them."""
    positions = np.concatenate([path.position for path in paths], axis=1)
    low, high = positions.min(axis=1) - MARGIN_M, positions.max(axis=1) + MARGIN_M
    (left, bottom), (right, top) = low.tolist(), high.tolist()
    return (left, right), (bottom, top)


def _finite(lines: tuple[ChartLine, ...] | list[ChartLine]) -> Array:
    values = np.concatenate([line.value for line in lines]) if lines else np.empty(0)
    return np.asarray(values[np.isfinite(values)], dtype=float)
