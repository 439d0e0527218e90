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
from trackbench.subjects.recording.thinning import extremes

#: The recording's one timeline, seconds of simulated time.
TIMELINE = "sim_time"
#: The rotation of a frame whose y is down.
Y_DOWN = np.diag([1.0, -1.0, 1.0])
#: RGBA of rows.
Colours = npt.NDArray[np.uint32]
#: Rows at each time.
Count = npt.NDArray[np.integer[Any]]


def path(*parts: str) -> str:
    """Return an entity path; names are escaped, so that any name of a tracker or sensor is one part."""
    return str(rr.new_entity_path(list(parts)))


def rgba(colour: str) -> int:
    """Return an opaque colour out of "#RRGGBB"."""
    return int(colour[1:] + "FF", 16)


def rgba_of(colours: Iterable[str]) -> Colours:
    """Return opaque colours out of "#RRGGBB" each."""
    return np.array([rgba(colour) for colour in colours], dtype=np.uint32)


def pixels(size: float) -> float:
    """Return a radius on the screen, whatever the zoom: Rerun takes negative radii for that."""
    return -size


class Stream:
    """One recording that is being written."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording

    def static(self, entity: str, *archetypes: AsComponents) -> None:
        """Send what does not change over time."""
        self._recording.log(entity, *archetypes, static=True, strict=True)

    def columns(self, entity: str, time: Array, *batches: Iterable[ComponentColumn]) -> None:
        """Send what changes over time: one row for each of ``time`` (s) in every batch."""
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
        """Send what changes over time in a style that does not: a row, or ``count`` rows, for each of ``time`` (s)."""
        self.columns(entity, time, *(batches if count is None else [batch.partition(count) for batch in batches]))
        self.static(entity, style)

    def turn_y_down(self, entity: str) -> None:
        """Make an entity a frame whose y is down, as Rerun's 2D views have it, so that a left turn goes left."""
        self.static(entity, rr.Transform3D(mat3x3=Y_DOWN))

    def markdown(self, entity: str, text: str) -> None:
        """Send a text in Markdown."""
        self.static(entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))


#: Half axes of the 95 % ellipse over the standard deviations.
ELLIPSE_95 = float(np.sqrt(point95(2)))
#: Corners of an ellipse, which is drawn as a line: Rerun turns one ellipse an entity.
CORNERS = 25


def outlines(at: Array, p_00: Array, p_01: Array, p_11: Array) -> npt.NDArray[np.float32]:
    """Return the 95 % ellipses of positions ``at`` ``(rows, 2)`` m as closed lines, ``(rows, CORNERS, 2)`` m."""
    middle, spread = (p_00 + p_11) / 2, np.hypot((p_00 - p_11) / 2, p_01)
    major, minor = (ELLIPSE_95 * np.sqrt(np.maximum(middle + sign * spread, 0.0)) for sign in (1, -1))
    rotation, angle = np.arctan2(2 * p_01, p_00 - p_11) / 2, np.linspace(0, 2 * np.pi, CORNERS)
    along, across = major[:, None] * np.cos(angle), minor[:, None] * np.sin(angle)
    cosine, sine = np.cos(rotation)[:, None], np.sin(rotation)[:, None]
    turned = np.stack([cosine * along - sine * across, sine * along + cosine * across], axis=2)
    return np.asarray(at[:, None] + turned, dtype=np.float32)


def counts(when: Array, time: Array) -> Count:
    """Return how many rows there are at each instant, ``(instants,)``, of the times of rows, s."""
    return np.bincount(np.searchsorted(time, when - 1e-9), minlength=len(time))


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
    """Send dots of ``size`` pixels at the places ``at`` ``(2, dots)`` m and the times ``(times,)`` s.

    ``count`` ``(times,)`` is how many there are at each time, one unless given; the highest ``order`` is on top.
    """
    style = rr.Points2D.from_fields(colors=rgba(colour), radii=pixels(size), draw_order=order)
    stream.draw(entity, time, style, rr.Points2D.columns(positions=at.T), count=count)


def send_line(
    stream: Stream, entity: str, time: Array, values: Array, name: str, colour: str, width: float = 1.5
) -> None:
    """Send a line of a plot, broken where there is no value; its ``width`` is in pixels."""
    drawn = extremes(values)
    time, values = time[drawn], values[drawn]
    finite = np.isfinite(values)
    # An empty row breaks the line.
    stream.columns(entity, time, rr.Scalars.columns(scalars=values[finite]).partition(finite.astype(int)))
    style: dict[str, Any] = {"colors": rgba(colour), "widths": width, "names": name}
    stream.static(entity, rr.SeriesLines(**style))
