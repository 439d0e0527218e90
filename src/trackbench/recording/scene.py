"""The scene of the recorded run, seen from above: roads, vehicles, measurements, estimates and their covariances.

Everything below ``world`` is in metres of the fixed frame. A 2D view of Rerun has y down, so a view takes one of the
frames as its origin: they move with a vehicle, which the view then follows, and have y down too, so that a left turn
goes left.
"""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import rerun as rr

from trackbench.metrics.consistency import point95
from trackbench.palette import OBSERVER_COLOUR, TRUTH_COLOUR
from trackbench.recording.stream import Stream, path, pixels, rgba
from trackbench.recording.tables import Columns, columns, split
from trackbench.types import Array

WORLD = ("world",)
ROADS = (*WORLD, "roads")
VEHICLES = (*WORLD, "vehicles")
MEASUREMENTS = (*WORLD, "measurements")
ESTIMATES = (*WORLD, "estimates")
LABELS = (*WORLD, "labels")
#: Move with each vehicle without turning.
FRAMES = (*WORLD, "frames")
ROAD_COLOUR = "#4A4F57"
LABEL_COLOUR = "#C8CDD4"

#: Half axes of the 95 % ellipse over the standard deviations.
ELLIPSE_95 = float(np.sqrt(point95(2)))


def ellipse(p_00: Array, p_01: Array, p_11: Array) -> tuple[Array, Array]:
    """Half axes ``(rows, 2)`` m and rotation ``(rows,)`` rad of the 95 % ellipses of position covariances."""
    middle, spread = (p_00 + p_11) / 2, np.hypot((p_00 - p_11) / 2, p_01)
    variances = np.stack([middle + spread, middle - spread], axis=1)
    return ELLIPSE_95 * np.sqrt(np.maximum(variances, 0.0)), np.arctan2(2 * p_01, p_00 - p_11) / 2


def send_roads(stream: Stream, roads: pa.Table) -> None:
    """The lane edges."""
    rows = columns(roads)
    line = rows["line"]
    points = np.stack([rows["x_m"], rows["y_m"]], axis=1)
    strips = np.split(points, np.flatnonzero(np.diff(line)) + 1) if len(line) else []
    lanes = rr.LineStrips2D(strips, colors=rgba(ROAD_COLOUR), radii=pixels(1.0), draw_order=0.0)
    stream.static(path(*ROADS), lanes)


def send_vehicles(stream: Stream, truth: pa.Table) -> None:
    """The observer and the targets, as oriented boxes with an arrow for the heading, and their names."""
    for (name, role), rows in split(truth, "object", "role").items():
        observer = role == "observer"
        colour = OBSERVER_COLOUR if observer else TRUTH_COLOUR
        alive = rows["alive"].astype(bool)
        px, py = rows["px_m"][alive], rows["py_m"][alive]
        y_down = np.tile(np.diag([1.0, -1.0, 1.0]), (len(px), 1, 1))
        frame = rr.Transform3D.columns(translation=_in_plane(px, py), mat3x3=y_down)
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
    _labels(stream, columns(truth))


def send_measurements(stream: Stream, measurements: pa.Table, colours: dict[str, str]) -> None:
    """Each sensor's measurements, where they lie in the fixed frame."""
    for (sensor,), rows in split(measurements, "sensor").items():
        valid = rows["valid"].astype(bool)
        time, count = np.unique(rows["time_s"][valid], return_counts=True)
        points = np.stack([rows["x_m"], rows["y_m"]], axis=1)[valid]
        entity = path(*MEASUREMENTS, sensor)
        stream.columns(entity, time, rr.Points2D.columns(positions=points).partition(count))
        style = rr.Points2D.from_fields(colors=rgba(colours[sensor]), radii=pixels(1.5), draw_order=20.0)
        stream.static(entity, style)


def send_estimates(stream: Stream, estimates: pa.Table, truth: pa.Table, colours: dict[str, str], hold: float) -> None:
    """Each tracker's estimate and 95 % ellipse of every target.

    Args:
        hold: how long an estimate stays in the picture when none follows, s.
    """
    vehicles = split(truth, "object")
    for (tracker, name), found in split(estimates, "tracker", "object").items():
        known = np.isfinite(found["px_m"]) & np.isfinite(found["py_m"])
        rows = {key: values[known] for key, values in found.items()}
        truth_rows = vehicles[name,]
        gone = truth_rows["time_s"][~truth_rows["alive"].astype(bool)]
        time, count = _with_ends(rows["time_s"], gone, hold, truth_rows["time_s"][-1])
        entity = path(*ESTIMATES, tracker, name)
        points = np.stack([rows["px_m"], rows["py_m"]], axis=1)
        stream.columns(entity, time, rr.Points2D.columns(positions=points).partition(count))
        dot = rr.Points2D.from_fields(colors=rgba(colours[tracker]), radii=pixels(2.5), draw_order=30.0)
        stream.static(entity, dot)

        half, rotation = ellipse(rows["p_00"], rows["p_01"], rows["p_11"])
        batches = (
            _pose(rows["px_m"], rows["py_m"], rotation),
            rr.Ellipses2D.columns(half_sizes=half, centers=np.zeros_like(half)),
        )
        covariance = f"{entity}/covariance"
        stream.columns(covariance, time, *(batch.partition(count) for batch in batches))
        outline = rr.Ellipses2D.from_fields(colors=rgba(colours[tracker]), line_radii=pixels(0.75), draw_order=25.0)
        stream.static(covariance, outline)


def _labels(stream: Stream, rows: Columns) -> None:
    # Rerun 0.41 draws the labels of boxes and ellipses where they would be without transforms; those of points follow.
    order = np.argsort(rows["time_s"], kind="stable")
    alive = rows["alive"].astype(bool)[order]
    time, index = np.unique(rows["time_s"][order], return_inverse=True)
    count = np.bincount(index, weights=alive).astype(int)
    shown = order[alive]
    below = np.stack([rows["px_m"], rows["py_m"] - rows["width_m"]], axis=1)[shown]
    labels = [str(name) for name in rows["object"][shown]]
    stream.columns(path(*LABELS), time, rr.Points2D.columns(positions=below, labels=labels).partition(count))
    style = rr.Points2D.from_fields(colors=rgba(LABEL_COLOUR), radii=0.0, show_labels=True, draw_order=40.0)
    stream.static(path(*LABELS), style)


def _with_ends(time: Array, gone: Array, hold: float, last: float) -> tuple[Array, np.ndarray]:
    """Times, with an empty row wherever nothing follows within ``hold`` or the object is gone; each row's length."""
    following = np.append(time[1:], np.inf)
    first_gone = np.append(gone, np.inf)[np.searchsorted(gone, time, side="right")]
    end = np.minimum(time + hold, first_gone)
    ends = end[(end < following - 1e-9) & (end < last + 1e-9)]
    every = np.concatenate([time, ends])
    order = np.argsort(every, kind="stable")
    return every[order], np.repeat([1, 0], [len(time), len(ends)])[order]


def _pose(x: Array, y: Array, angle: Array) -> rr.ComponentColumnList:
    zero = np.zeros_like(x)
    quaternion = np.stack([zero, zero, np.sin(angle / 2), np.cos(angle / 2)], axis=1)
    return rr.Transform3D.columns(translation=_in_plane(x, y), quaternion=quaternion)


def _in_plane(x: Array, y: Array) -> Array:
    return np.stack([x, y, np.zeros_like(x)], axis=1)
