"""What the parts of a recording write to: entities by path, columns over simulated time, points, ellipses, lines."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr
from rerun import AsComponents, ComponentColumn

from trackbench.base.types import Array
from trackbench.metrics.consistency import point95

#: The recording's one timeline, seconds of simulated time.
TIMELINE = "sim_time"
#: The rotation of a frame whose y is down.
Y_DOWN = np.diag([1.0, -1.0, 1.0])
#: Rows at each time.
Count = npt.NDArray[np.integer[Any]]


def path(*parts: str) -> str:
    """An entity path; names are escaped, so that any name of a tracker or sensor is one part."""
    return str(rr.new_entity_path(list(parts)))


def rgba(colour: str) -> int:
    """An opaque colour out of "#RRGGBB"."""
    return int(colour[1:] + "FF", 16)


def pixels(size: float) -> float:
    """A radius on the screen, whatever the zoom: Rerun takes negative radii for that."""
    return -size


class Stream:
    """One recording that is being written."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording

    def static(self, entity: str, *archetypes: AsComponents) -> None:
        """What does not change over time."""
        self._recording.log(entity, *archetypes, static=True, strict=True)

    def columns(self, entity: str, time: Array, *batches: Iterable[ComponentColumn]) -> None:
        """What changes over time: one row for each of ``time`` (s) in every batch."""
        if len(time):
            nanoseconds = np.round(time * 1e9).astype("timedelta64[ns]")
            index: Any = rr.TimeColumn(TIMELINE, duration=nanoseconds)
            flat = [column for batch in batches for column in batch]
            self._recording.send_columns(entity, [index], flat, strict=True)

    def draw(
        self,
        entity: str,
        time: Array,
        style: AsComponents,
        *batches: rr.ComponentColumnList,
        count: Count | None = None,
    ) -> None:
        """What changes over time in a style that does not: one row, or ``count`` rows, for each of ``time`` (s)."""
        self.columns(entity, time, *(batches if count is None else [batch.partition(count) for batch in batches]))
        self.static(entity, style)

    def turn_y_down(self, entity: str) -> None:
        """Make an entity a frame whose y is down, as Rerun's 2D views have it, so that a left turn goes left."""
        self.static(entity, rr.Transform3D(mat3x3=Y_DOWN))

    def log(self, entity: str, time: list[float], texts: list[str], warnings: list[bool]) -> None:
        """A log: a text at each time (s), as a warning or as information."""
        if texts:
            levels = ["WARN" if warning else "INFO" for warning in warnings]
            self.columns(entity, np.array(time), rr.TextLog.columns(text=texts, level=levels))

    def markdown(self, entity: str, text: str) -> None:
        """A text."""
        self.static(entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))


#: Half axes of the 95 % ellipse over the standard deviations.
ELLIPSE_95 = float(np.sqrt(point95(2)))


def ellipse(p_00: Array, p_01: Array, p_11: Array) -> tuple[Array, Array]:
    """Half axes ``(rows, 2)`` m and rotation ``(rows,)`` rad of the 95 % ellipses of position covariances."""
    middle, spread = (p_00 + p_11) / 2, np.hypot((p_00 - p_11) / 2, p_01)
    variances = np.stack([middle + spread, middle - spread], axis=1)
    return ELLIPSE_95 * np.sqrt(np.maximum(variances, 0.0)), np.arctan2(2 * p_01, p_00 - p_11) / 2


def send_points(
    stream: Stream,
    entity: str,
    time: Array,
    at: Array,
    colour: str,
    size: float,
    order: float,
    count: Count | None = None,
) -> None:
    """Dots of ``size`` pixels at the places ``at`` ``(2, dots)`` m and the times ``(times,)`` s.

    ``count`` ``(times,)`` is how many there are at each time, one unless given; the highest ``order`` is on top.
    """
    style = rr.Points2D.from_fields(colors=rgba(colour), radii=pixels(size), draw_order=order)
    stream.draw(entity, time, style, rr.Points2D.columns(positions=at.T), count=count)


def send_ellipses(
    stream: Stream,
    entity: str,
    time: Array,
    at: Array,
    covariance: Array,
    colour: str,
    order: float,
    count: Count | None = None,
) -> None:
    """The 95 % ellipses of positions with their covariances ``(2, 2, dots)`` m^2; the rest as :func:`send_points`."""
    half, rotation = ellipse(covariance[0, 0], covariance[0, 1], covariance[1, 1])
    ellipses = rr.Ellipses2D.columns(half_sizes=half, centers=np.zeros_like(half))
    style = rr.Ellipses2D.from_fields(colors=rgba(colour), line_radii=pixels(0.75), draw_order=order)
    stream.draw(entity, time, style, pose(at[0], at[1], rotation), ellipses, count=count)


def send_line(
    stream: Stream, entity: str, time: Array, values: Array, name: str, colour: str, width: float = 1.5
) -> None:
    """A line of a plot, broken where there is no value; its ``width`` is in pixels."""
    finite = np.isfinite(values)
    # An empty row breaks the line.
    stream.columns(entity, time, rr.Scalars.columns(scalars=values[finite]).partition(finite.astype(int)))
    style: dict[str, Any] = {"colors": rgba(colour), "widths": width, "names": name}
    stream.static(entity, rr.SeriesLines(**style))


def pose(x: Array, y: Array, angle: Array) -> rr.ComponentColumnList:
    """Where something is, m, and how it is turned, rad."""
    zero = np.zeros_like(x)
    quaternion = np.stack([zero, zero, np.sin(angle / 2), np.cos(angle / 2)], axis=1)
    return rr.Transform3D.columns(translation=in_plane(x, y), quaternion=quaternion)


def in_plane(x: Array, y: Array) -> Array:
    """``(rows, 3)`` of points in the plane."""
    return np.stack([x, y, np.zeros_like(x)], axis=1)
