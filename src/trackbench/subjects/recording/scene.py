"""The scene of the recorded run, seen from above: roads, vehicles, measurements, estimates and their covariances.

Everything below ``world`` is in metres of the fixed frame. A 2D view of Rerun has y down, so a view takes one of the
frames as its origin: they move with a vehicle, which the view then follows, and have y down too, so that a left turn
goes left.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import pyarrow as pa
import rerun as rr

from trackbench.base.types import Array
from trackbench.document.palette import OBSERVER_COLOUR, TRUTH_COLOUR
from trackbench.results.columns import Columns, split, table_columns
from trackbench.subjects.recording.stream import (
    Y_DOWN,
    Stream,
    in_plane,
    path,
    pixels,
    pose,
    rgba,
    send_ellipses,
    send_points,
)

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


def send_roads(stream: Stream, roads: pa.Table) -> None:
    """The lane edges."""
    rows = table_columns(roads)
    line = rows["line"]
    points = np.stack([rows["x_m"], rows["y_m"]], axis=1)
    strips = np.split(points, np.flatnonzero(np.diff(line)) + 1) if len(line) else []
    edges = rr.LineStrips2D(strips, colors=rgba(ROAD_COLOUR), radii=pixels(1.0), draw_order=0.0)
    stream.static(path(*ROADS), edges)


def send_vehicles(stream: Stream, truth: pa.Table, metres_per_pixel: float, names_above: bool = False) -> None:
    """The observer and the targets, as oriented boxes with an arrow for the heading, and their names.

    ``metres_per_pixel`` is the scale of the view that shows the names, which stand below the vehicles unless
    ``names_above``.
    """
    if not truth.num_rows:
        return
    for (name, role), rows in split(truth, "object", "role").items():
        observer = role == "observer"
        colour = OBSERVER_COLOUR if observer else TRUTH_COLOUR
        alive = rows["alive"].astype(bool)
        px, py = rows["px_m"][alive], rows["py_m"][alive]
        frame = rr.Transform3D.columns(translation=in_plane(px, py), mat3x3=np.tile(Y_DOWN, (len(px), 1, 1)))
        stream.columns(path(*FRAMES, name), rows["time_s"][alive], frame)

        entity = path(*VEHICLES, name)
        # A fixed observer has no size; it is drawn as a square metre.
        half = np.maximum(np.stack([rows["length_m"], rows["width_m"]], axis=1)[alive] / 2, 0.5)
        nose = half * (1.0, 0.0)
        batches = (
            pose(px, py, rows["heading_rad"][alive]),
            rr.Boxes2D.columns(half_sizes=half, centers=np.zeros_like(half)),
            rr.Arrows2D.columns(vectors=nose, origins=np.zeros_like(half)),
        )
        stream.columns(entity, rows["time_s"], *(batch.partition(alive.astype(int)) for batch in batches))
        box = rr.Boxes2D.from_fields(colors=rgba(colour), radii=pixels(1.5))
        arrow = rr.Arrows2D.from_fields(colors=rgba(colour), radii=pixels(1.0))
        stream.static(entity, box, arrow)
    _labels(stream, truth, metres_per_pixel, names_above)


def send_measurements(stream: Stream, measurements: pa.Table, colours: Mapping[str, str]) -> None:
    """Each sensor's measurements, where they lie in the fixed frame."""
    for (sensor,), rows in split(measurements, "sensor").items():
        valid = rows["valid"].astype(bool)
        time, count = np.unique(rows["time_s"][valid], return_counts=True)
        at = np.stack([rows["x_m"], rows["y_m"]])[:, valid]
        send_points(stream, path(*MEASUREMENTS, sensor), time, at, colours[sensor], 1.5, 20.0, count)


def send_estimates(
    stream: Stream, estimates: pa.Table, truth: pa.Table, colours: Mapping[str, str], hold: float | None = None
) -> None:
    """Each tracker's estimate and 95 % ellipse of every target.

    ``hold`` (s) is how long an estimate stays in the picture when none follows; None while a run goes on, when nothing
    is known of what follows the last one.
    """
    vehicles = split(truth, "object")
    for (tracker, name), every in split(estimates, "tracker", "object").items():
        finite = np.isfinite(every["px_m"]) & np.isfinite(every["py_m"])
        rows = {key: values[finite] for key, values in every.items()}
        time, count = every["time_s"], finite.astype(int)
        if hold is not None:
            truth_rows = vehicles[name,]
            gone = truth_rows["time_s"][~truth_rows["alive"].astype(bool)]
            time, count = _with_ends(rows["time_s"], gone, hold, truth_rows["time_s"][-1])
        entity = path(*ESTIMATES, tracker, name)
        at, colour = np.stack([rows["px_m"], rows["py_m"]]), colours[tracker]
        covariance = np.array([[rows["p_00"], rows["p_01"]], [rows["p_01"], rows["p_11"]]])
        send_points(stream, entity, time, at, colour, 2.5, 30.0, count)
        send_ellipses(stream, f"{entity}/covariance", time, at, covariance, colour, 25.0, count)


def _labels(stream: Stream, truth: pa.Table, metres_per_pixel: float, above: bool) -> None:
    # Rerun 0.41 draws the labels of boxes and ellipses where they would be without transforms; those of points follow.
    vehicles = {name: rows for (name,), rows in split(truth, "object").items()}
    points = label_points(list(vehicles.values()), list(vehicles), metres_per_pixel, above)
    alive = np.stack([rows["alive"].astype(bool) for rows in vehicles.values()], axis=1)
    names = np.broadcast_to(np.array(list(vehicles)), alive.shape)
    shown = rr.Points2D.columns(positions=np.stack(points, axis=1)[alive], labels=[str(name) for name in names[alive]])
    time = next(iter(vehicles.values()))["time_s"]
    style = rr.Points2D.from_fields(colors=rgba(LABEL_COLOUR), radii=0.0, show_labels=True, draw_order=40.0)
    stream.draw(path(*LABELS), time, style, shown, count=alive.sum(axis=1))


def _with_ends(time: Array, gone: Array, hold: float, last: float) -> tuple[Array, np.ndarray]:
    """Times, with an empty row wherever nothing follows within ``hold`` or the object is gone; each row's length."""
    following = np.append(time[1:], np.inf)
    first_gone = np.append(gone, np.inf)[np.searchsorted(gone, time, side="right")]
    end = np.minimum(time + hold, first_gone)
    ends = end[(end < following - 1e-9) & (end < last + 1e-9)]
    every = np.concatenate([time, ends])
    order = np.argsort(every, kind="stable")
    return every[order], np.repeat([1, 0], [len(time), len(ends)])[order]


#: Length of a trail, s.
TRAIL_S = 2.0
TRUE = (*WORLD, "trails", "truth")
ESTIMATED = (*WORLD, "trails", "estimates")


def trails(trackers: Iterable[str]) -> list[str]:
    """The entities, which a view shows over the length of a trail."""
    return [path(*TRUE), *(path(*ESTIMATED, tracker) for tracker in trackers)]


def send_trails(stream: Stream, truth: pa.Table, estimates: pa.Table, colours: Mapping[str, str], hold: float) -> None:
    """At each instant the piece of line from the one before, at most ``hold`` (s) ago; a view puts them together."""
    vehicles = []
    for rows in split(truth, "object").values():
        alive = rows["alive"].astype(bool)
        vehicles.append({name: values[alive] for name, values in rows.items()})
    _send_trail(stream, path(*TRUE), vehicles, TRUTH_COLOUR, 1.0, 1.0, hold)
    by_tracker: dict[str, list[Columns]] = {}
    for (tracker, _), rows in split(estimates, "tracker", "object").items():
        by_tracker.setdefault(tracker, []).append(rows)
    for number, (tracker, tracks) in enumerate(by_tracker.items()):
        _send_trail(stream, path(*ESTIMATED, tracker), tracks, colours[tracker], 0.5, 10.0 + 0.1 * number, hold)


def _send_trail(
    stream: Stream, entity: str, tracks: list[Columns], colour: str, size: float, order: float, hold: float
) -> None:
    times, pieces = [], []
    for rows in tracks:
        time, at = rows["time_s"], np.stack([rows["px_m"], rows["py_m"]], axis=1)
        joined = np.isfinite(at[1:] + at[:-1]).all(axis=1) & (np.diff(time) <= hold + 1e-9)
        times.append(time[1:][joined])
        pieces.append(np.stack([at[:-1][joined], at[1:][joined]], axis=1))
    every, strips = np.concatenate(times), np.concatenate(pieces)
    order_of_time = np.argsort(every, kind="stable")
    time, count = np.unique(every, return_counts=True)
    style = rr.LineStrips2D.from_fields(colors=rgba(colour), radii=pixels(size), draw_order=order)
    stream.draw(entity, time, style, rr.LineStrips2D.columns(strips=strips[order_of_time]), count=count)


#: Pixels that a name takes: a letter, the room around it, its height, and the gap between its point and its top.
LETTER, AROUND, HEIGHT, GAP = 7.0, 14.0, 22.0, 6.0
#: What it costs to cover a name or a vehicle, over its share; a place other than the usual one costs its number.
NAME, VEHICLE, PLACE = 1.0, 0.3, 0.01


def label_points(
    vehicles: list[Columns], names: list[str], metres_per_pixel: float, above: bool = False
) -> list[Array]:
    """Where the points are under which the names are drawn.

    Args:
        vehicles: the same times of each, with ``px_m``, ``py_m``, ``length_m``, ``width_m`` and ``alive``.
        names: of each.
        metres_per_pixel: of the view.
        above: whether a name stands above its vehicle rather than below it.

    Returns:
        For each vehicle ``(times, 2)`` m, in the fixed frame.
    """
    at = [np.stack([rows["px_m"], rows["py_m"]], axis=1) for rows in vehicles]
    there = [rows["alive"].astype(bool) for rows in vehicles]
    reach = [float(np.nanmax(rows["length_m"], initial=1.0)) / 2 for rows in vehicles]
    placed: list[tuple[Array, Array]] = []
    points = []
    for i, name in enumerate(names):
        half = np.array([LETTER * len(name) + AROUND, HEIGHT]) / 2 * metres_per_pixel
        beside = reach[i] + half[0]
        below = float(np.nanmax(vehicles[i]["width_m"], initial=1.0)) + half[1]
        # The middle of the name, from that of the vehicle: below it, above, right, left, and farther below.
        right, down = (beside, 0.0), (0.0, -below)
        places = np.array([down, (0.0, below), right, (-beside, 0.0), (0.0, -below - 2 * half[1])])
        if above:
            places[:, 1] *= -1
        middle = at[i][None] + places[:, None]
        cost = np.repeat(PLACE * np.arange(len(places))[:, None], len(at[i]), axis=1)
        for other_middle, other_half in placed:
            cost += NAME * _covered(middle, half, other_middle, other_half)
        for k in range(len(names)):
            if k != i:
                size = np.full(2, reach[k] / 2)
                cost += VEHICLE * np.where(there[k], _covered(middle, half, at[k], size), 0.0)
        best = middle[np.argmin(cost, axis=0), np.arange(len(at[i]))]
        placed.append((np.where(there[i][:, None], best, np.inf), half))
        points.append(best + np.array([0.0, half[1] + GAP * metres_per_pixel]))
    return points


def _covered(middle: Array, half: Array, other: Array, other_half: Array) -> Array:
    """The share of a box that another covers."""
    with np.errstate(invalid="ignore"):
        overlap = np.clip(half + other_half - np.abs(middle - other), 0.0, 2 * np.minimum(half, other_half))
    return np.asarray(np.prod(overlap / (2 * half), axis=-1))
