"""The stream to which a recording is written: entities by path, columns over simulated time, points and lines."""

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

#: Name of the only timeline: simulated time, s.
TIMELINE = "sim_time"
#: Matrix of a frame whose y axis points down.
Y_DOWN = np.diag([1.0, -1.0, 1.0])
#: RGBA colour of each row.
Colours = npt.NDArray[np.uint32]
#: Number of rows at each time.
Count = npt.NDArray[np.integer[Any]]


def path(*parts: str) -> str:
    """Return an entity path from its parts, which are escaped, so that any tracker or sensor name is one part."""
    return str(rr.new_entity_path(list(parts)))


def rgba(colour: str) -> int:
    """Return an opaque colour from "#RRGGBB"."""
    return int(colour[1:] + "FF", 16)


def rgba_of(colours: Iterable[str]) -> Colours:
    """Return opaque colours from "#RRGGBB" texts, ``(colours,)``."""
    return np.array([rgba(colour) for colour in colours], dtype=np.uint32)


def pixels(size: float) -> float:
    """Return a radius in pixels, which does not depend on the zoom: for Rerun it is negative."""
    return -size


class Stream:
    """Recording that is being written."""

    def __init__(self, recording: rr.RecordingStream) -> None:
        self._recording = recording

    def static(self, entity: str, *archetypes: AsComponents) -> None:
        """Send components that do not change over time."""
        self._recording.log(entity, *archetypes, static=True, strict=True)

    def columns(self, entity: str, time: Array, *batches: Iterable[ComponentColumn]) -> None:
        """Send components that change over time: one row in each batch for each of ``time`` (s)."""
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
        """Send components over time in a constant style: one row, or ``count`` rows, for each of ``time`` (s)."""
        self.columns(entity, time, *(batches if count is None else [batch.partition(count) for batch in batches]))
        self.static(entity, style)

    def turn_y_down(self, entity: str) -> None:
        """Make an entity a frame whose y axis points down, as in Rerun's 2D views, so that a left turn goes left."""
        self.static(entity, rr.Transform3D(mat3x3=Y_DOWN))

    def markdown(self, entity: str, text: str) -> None:
        self.static(entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))


#: Ratio of the 95 % ellipse's half axes to the standard deviations.
ELLIPSE_95 = float(np.sqrt(point95(2)))
#: Number of corners of an ellipse, which is drawn as a line since Rerun can turn only one ellipse an entity.
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
    """Return how many rows lie at each instant of ``time``, ``(instants,)``; ``when`` has the time of each row, s."""
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
    """Send dots of ``size`` pixels at positions ``at`` ``(2, dots)``, m, and times ``(times,)``, s.

    ``count`` ``(times,)`` is the number of dots at each time, None for one; the highest ``order`` is on top.
    """
    style = rr.Points2D.from_fields(colors=rgba(colour), radii=pixels(size), draw_order=order)
    stream.draw(entity, time, style, rr.Points2D.columns(positions=at.T), count=count)


def send_line(
    stream: Stream, entity: str, time: Array, values: Array, name: str, colour: str, width: float = 1.5
) -> None:
    """Send a line of a plot, broken where a value is missing; ``width`` is in pixels."""
    drawn = extremes(values)
    time, values = time[drawn], values[drawn]
    finite = np.isfinite(values)
    # An empty row breaks the line.
    stream.columns(entity, time, rr.Scalars.columns(scalars=values[finite]).partition(finite.astype(int)))
    style: dict[str, Any] = {"colors": rgba(colour), "widths": width, "names": name}
    stream.static(entity, rr.SeriesLines(**style))
