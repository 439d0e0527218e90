"""Points, ellipses and lines over simulated time, in one colour each."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr

from trackbench.base.types import Array
from trackbench.metrics.consistency import point95
from trackbench.subjects.recording.stream import Stream, pixels, rgba

#: Rows at each time.
Count = npt.NDArray[np.integer[Any]]

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
    """Dots.

    Args:
        stream: the recording.
        entity: their path.
        time: ``(times,)`` s.
        at: ``(2, dots)`` m.
        colour: "#RRGGBB".
        size: radius in pixels.
        order: of drawing; the highest is on top.
        count: ``(times,)`` how many dots there are at each time; one unless given.
    """
    dots = rr.Points2D.columns(positions=at.T)
    stream.columns(entity, time, dots if count is None else dots.partition(count))
    stream.static(entity, rr.Points2D.from_fields(colors=rgba(colour), radii=pixels(size), draw_order=order))


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
    batches = pose(at[0], at[1], rotation), rr.Ellipses2D.columns(half_sizes=half, centers=np.zeros_like(half))
    stream.columns(entity, time, *(batch if count is None else batch.partition(count) for batch in batches))
    stream.static(entity, rr.Ellipses2D.from_fields(colors=rgba(colour), line_radii=pixels(0.75), draw_order=order))


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
