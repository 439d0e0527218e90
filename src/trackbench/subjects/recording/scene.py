"""The scene of the recorded run, seen from above: roads, vehicles, measurements and trails.

Entities below ``world`` are in metres of the fixed frame. Rerun's 2D views have y down. Therefore the origin of a view
is a frame with y down, so that a left turn goes left; it moves with a vehicle, which the view follows.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import rerun as rr

from trackbench.base.types import Array
from trackbench.document.palette import OBSERVER_COLOUR, TRUTH_COLOUR
from trackbench.results.columns import Columns, split, table_columns
from trackbench.subjects.recording.stream import (
    Y_DOWN,
    Colours,
    Stream,
    counts,
    path,
    pixels,
    rgba,
    send_points,
)

WORLD = ("world",)
ROADS = (*WORLD, "roads")
VEHICLES = (*WORLD, "vehicles")
MEASUREMENTS = (*WORLD, "measurements")
LABELS = (*WORLD, "labels")
TRAILS = (*WORLD, "trails")
TRUE_TRAILS = (*TRAILS, "truth")
#: Frames that move with each vehicle without turning.
FRAMES = (*WORLD, "frames")
ROAD_COLOUR = "#4A4F57"
LABEL_COLOUR = "#C8CDD4"
#: Length of a trail, s.
TRAIL_S = 2.0
#: Height of a vehicle's name, with the gap to the point above it, pixels.
NAME_HEIGHT = 32.0


def send_roads(stream: Stream, roads: pa.Table) -> None:
    rows = table_columns(roads)
    line = rows["line"]
    points = np.stack([rows["x_m"], rows["y_m"]], axis=1)
    strips = np.split(points, np.flatnonzero(np.diff(line)) + 1) if len(line) else []
    edges = rr.LineStrips2D(strips, colors=rgba(ROAD_COLOUR), radii=pixels(1.0), draw_order=0.0)
    stream.static(path(*ROADS), edges)


def send_vehicles(stream: Stream, truth: pa.Table, metres_per_pixel: float) -> None:
    """Send the observer and the targets as oriented boxes with an arrow for the heading, and their names above.

    ``metres_per_pixel`` is the scale of the view that shows the names.
    """
    if not truth.num_rows:
        return
    for (name, role), rows in split(truth, "object", "role").items():
        observer = role == "observer"
        colour = OBSERVER_COLOUR if observer else TRUTH_COLOUR
        alive = rows["alive"].astype(bool)
        px, py = rows["px_m"][alive], rows["py_m"][alive]
        frame = rr.Transform3D.columns(translation=_in_plane(px, py), mat3x3=np.tile(Y_DOWN, (len(px), 1, 1)))
        stream.columns(path(*FRAMES, name), rows["time_s"][alive], frame)

        entity = path(*VEHICLES, name)
        # A fixed observer has no size; it is drawn as a square metre.
        half = np.maximum(np.stack([rows["length_m"], rows["width_m"]], axis=1)[alive] / 2, 0.5)
        nose = half * (1.0, 0.0)
        batches = (
            _pose(px, py, rows["heading_rad"][alive]),
            rr.Boxes2D.columns(half_sizes=half, centers=np.zeros_like(half)),
            rr.Arrows2D.columns(vectors=nose, origins=np.zeros_like(half)),
        )
        stream.columns(entity, rows["time_s"], *(batch.partition(alive.astype(int)) for batch in batches))
        box = rr.Boxes2D.from_fields(colors=rgba(colour), radii=pixels(1.5))
        arrow = rr.Arrows2D.from_fields(colors=rgba(colour), radii=pixels(1.0))
        stream.static(entity, box, arrow)
    _send_labels(stream, truth, metres_per_pixel)


def send_measurements(stream: Stream, measurements: pa.Table, colours: Mapping[str, str]) -> None:
    """Send each sensor's measurements at their positions in the fixed frame."""
    for (sensor,), rows in split(measurements, "sensor").items():
        valid = rows["valid"].astype(bool)
        time, count = np.unique(rows["time_s"][valid], return_counts=True)
        at = np.stack([rows["x_m"], rows["y_m"]])[:, valid]
        send_points(stream, path(*MEASUREMENTS, sensor), time, at, colours[sensor], 1.5, 20.0, count)


def _send_labels(stream: Stream, truth: pa.Table, metres_per_pixel: float) -> None:
    # Rerun 0.41 ignores transforms for the labels of boxes and ellipses, but not for labels of points.
    rows = table_columns(truth)
    alive_rows = np.flatnonzero(rows["alive"])
    alive_rows = alive_rows[np.argsort(rows["time_s"][alive_rows], kind="stable")]
    rows, time = {name: values[alive_rows] for name, values in rows.items()}, np.unique(rows["time_s"])
    # Rerun draws a label below its point.
    at = np.stack([rows["px_m"], rows["py_m"] + _half_extent_y(rows) + NAME_HEIGHT * metres_per_pixel], axis=1)
    shown = rr.Points2D.columns(positions=at, labels=rows["object"].tolist())
    style = rr.Points2D.from_fields(colors=rgba(LABEL_COLOUR), radii=0.0, show_labels=True, draw_order=40.0)
    stream.draw(path(*LABELS), time, style, shown, count=counts(rows["time_s"], time))


def _half_extent_y(vehicle: Columns) -> Array:
    """Return half of a body's extent along y, ``(times,)``, m."""
    along, across = np.abs(np.sin(vehicle["heading_rad"])), np.abs(np.cos(vehicle["heading_rad"]))
    return np.asarray((along * vehicle["length_m"] + across * vehicle["width_m"]) / 2)


def send_true_trail(stream: Stream, truth: pa.Table) -> None:
    rows = table_columns(truth)
    alive = {name: values[rows["alive"].astype(bool)] for name, values in rows.items()}
    colours = np.full(len(alive["time_s"]), rgba(TRUTH_COLOUR), dtype=np.uint32)
    send_trail(stream, path(*TRUE_TRAILS), np.unique(rows["time_s"]), alive, alive["object"], colours, 1.0, 1.0)


def send_trail(
    stream: Stream,
    entity: str,
    time: Array,
    rows: Columns,
    identity: npt.NDArray[Any],
    colours: Colours,
    radius: float,
    order: float = 10.0,
) -> None:
    """Send at each instant the piece of each path since the previous instant; a view joins the pieces.

    Args:
        stream: the recording.
        entity: path of the trail's entity.
        time: all instants ``(instants,)``, s.
        rows: columns ``time_s``, ``px_m`` and ``py_m``.
        identity: name or number of each row's path, ``(rows,)``.
        colours: RGBA of each row, ``(rows,)``.
        radius: half the width of the line, pixels.
        order: drawing order; the highest is on top.
    """
    by_path = np.lexsort((rows["time_s"], np.unique(identity, return_inverse=True)[1]))
    identity, when, colours = identity[by_path], rows["time_s"][by_path], colours[by_path]
    at = np.stack([rows["px_m"], rows["py_m"]], axis=1)[by_path]
    joined = (identity[1:] == identity[:-1]) & (np.diff(np.searchsorted(time, when - 1e-9)) == 1)
    pieces, end = np.stack([at[:-1], at[1:]], axis=1)[joined], when[1:][joined]
    by_time = np.argsort(end, kind="stable")
    lines = rr.LineStrips2D.columns(strips=pieces[by_time], colors=colours[1:][joined][by_time])
    style = rr.LineStrips2D.from_fields(radii=pixels(radius), draw_order=order)
    stream.draw(entity, time, style, lines, count=counts(end, time))


def _pose(x: Array, y: Array, angle: Array) -> rr.ComponentColumnList:
    zero = np.zeros_like(x)
    quaternion = np.stack([zero, zero, np.sin(angle / 2), np.cos(angle / 2)], axis=1)
    return rr.Transform3D.columns(translation=_in_plane(x, y), quaternion=quaternion)


def _in_plane(x: Array, y: Array) -> Array:
    return np.stack([x, y, np.zeros_like(x)], axis=1)
