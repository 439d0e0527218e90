"""Tracks seen from above: trails in a colour for each identity, misses, events, and which detection each track took."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import rerun as rr

from trackbench.base.types import Array, Indices
from trackbench.document.palette import ERROR_COLOURS, IDENTITY_COLOURS
from trackbench.metrics.function_events import TrackEvent
from trackbench.results.columns import Columns, split
from trackbench.subjects.recording.functions import WARNED
from trackbench.subjects.recording.scene import HEIGHT, TRAIL_S, WORLD
from trackbench.subjects.recording.stream import Stream, ellipse, path, pixels, rgba

TRACKS = (*WORLD, "tracks")
COVARIANCES = (*WORLD, "track_covariances")
TRAILS = (*WORLD, "trails", "tracks")
MISSES = (*WORLD, "misses")
MARKS = (*WORLD, "marks")
ASSOCIATIONS = (*WORLD, "associations")
#: How long an event is marked, s.
MARKED_S = 1.0
#: Events that are marked; births and confirmations are not: a trail begins there.
MARKED = {"switched": "#FFFFFF", "merged": ERROR_COLOURS[4], "lost": ERROR_COLOURS[4], "false": ERROR_COLOURS[3]}
MISSED = ERROR_COLOURS[4]
ASSOCIATION_COLOUR = "#FFFFFF"
#: Of an ellipse that is drawn as a line.
CORNERS = 25
#: Opacity of a track that surely does not exist.
FAINTEST = 0.2


def entities(tracker: str) -> dict[str, float]:
    """What a view of one tracker shows beside the vehicles, and for how long, s; 0 for the latest alone."""
    return {
        path(*TRACKS, tracker): 0.0,
        path(*COVARIANCES, tracker): 0.0,
        path(*TRAILS, tracker): TRAIL_S,
        path(*MISSES, tracker): 0.0,
        path(*MARKS, tracker): MARKED_S,
        path(*MARKS, tracker, "labels"): MARKED_S,
        path(*WARNED, tracker): 0.0,
    }


def others() -> tuple[str, ...]:
    """What a view of one tracker leaves out, unless it names it: what is of the other trackers."""
    return tuple(
        f"- {path(*family)}/**" for family in (TRACKS, COVARIANCES, TRAILS, MISSES, MARKS, ASSOCIATIONS, WARNED)
    )


def send_tracks(stream: Stream, tracker: str, tracks: pa.Table, time: Array) -> None:
    """One tracker's tracks at all instants (s), with their identities as names and their existence as opacity."""
    rows = _sorted(tracks)
    at, colours = np.stack([rows["px_m"], rows["py_m"]], axis=1), _colours(rows)
    count = _counts(rows["time_s"], time)
    points = rr.Points2D.columns(positions=at, colors=colours, labels=[f"{int(track)}" for track in rows["track"]])
    style = rr.Points2D.from_fields(radii=pixels(3.0), draw_order=30.0, show_labels=True)
    stream.draw(path(*TRACKS, tracker), time, style, points, count=count)
    outlines = rr.LineStrips2D.columns(strips=_outlines(rows), colors=colours)
    thin = rr.LineStrips2D.from_fields(radii=pixels(0.75), draw_order=25.0)
    stream.draw(path(*COVARIANCES, tracker), time, thin, outlines, count=count)
    # At each instant the piece of each track's path from the instant before.
    order = np.lexsort((rows["time_s"], rows["track"]))
    track, when, at = rows["track"][order], rows["time_s"][order], at[order]
    joined = (track[1:] == track[:-1]) & (np.diff(np.searchsorted(time, when - 1e-9)) == 1)
    pieces, end, colour = np.stack([at[:-1], at[1:]], axis=1)[joined], when[1:][joined], colours[order][1:][joined]
    by_time = np.argsort(end, kind="stable")
    lines = rr.LineStrips2D.columns(strips=pieces[by_time], colors=colour[by_time])
    trail = rr.LineStrips2D.from_fields(radii=pixels(1.2), draw_order=10.0)
    stream.draw(path(*TRAILS, tracker), time, trail, lines, count=_counts(end[by_time], time))


def send_misses(stream: Stream, tracker: str, objects: pa.Table, truth: pa.Table, time: Array) -> None:
    """A ring around each due object without a track, at all instants (s), of its rows of objects' states."""
    vehicles = {name: rows for (name,), rows in split(truth, "object").items()}
    misses: list[tuple[Array, Array]] = [(np.empty(0), np.empty((0, 2)))]
    for (name, state), rows in split(objects, "object", "state").items():
        if state not in ("waiting", "lost"):
            continue
        start, until = rows["time_s"][:, None], rows["until_s"][:, None]
        missed = time[((time >= start - 1e-9) & (time < until - 1e-9)).any(axis=0)]
        step = np.searchsorted(vehicles[name]["time_s"], missed - 1e-9)
        misses.append((missed, np.stack([vehicles[name]["px_m"][step], vehicles[name]["py_m"][step]], axis=1)))
    when, at = (np.concatenate(parts) for parts in zip(*misses, strict=True))
    order = np.argsort(when, kind="stable")
    rings = rr.Ellipses2D.columns(half_sizes=np.full((len(at), 2), 3.0), centers=at[order])
    style = rr.Ellipses2D.from_fields(colors=rgba(MISSED), line_radii=pixels(1.5), draw_order=35.0)
    stream.draw(path(*MISSES, tracker), time, style, rings, count=_counts(when[order], time))


def send_marks(stream: Stream, tracker: str, events: list[TrackEvent], metres_per_pixel: float) -> None:
    """Switches, losses and the beginnings of false tracks, where and when they happened.

    ``metres_per_pixel`` is the scale of the view: what they are is written below the numbers of the tracks.
    """
    shown = sorted((event for event in events if event.kind in MARKED), key=lambda event: event.time_s)
    if not shown:
        return
    time, count = np.unique([event.time_s for event in shown], return_counts=True)
    at = np.array([(event.x_m, event.y_m) for event in shown])
    colours = np.array([rgba(MARKED[event.kind]) for event in shown], dtype=np.uint32)
    style = rr.Points2D.from_fields(radii=pixels(5.0), draw_order=38.0)
    points = rr.Points2D.columns(positions=at, colors=colours)
    stream.draw(path(*MARKS, tracker), time, style, points, count=count)
    below = at - (0.0, HEIGHT * metres_per_pixel)
    texts = rr.Points2D.columns(positions=below, colors=colours, labels=[_label(event) for event in shown])
    style = rr.Points2D.from_fields(radii=0.0, draw_order=38.0, show_labels=True)
    stream.draw(path(*MARKS, tracker, "labels"), time, style, texts, count=count)


def send_associations(
    stream: Stream, tracker: str, taken: pa.Table, tracks: pa.Table, measurements: pa.Table, time: Array
) -> None:
    """A line from each track to the detection that it took, which has a ring, at all instants (s).

    ``taken`` and ``tracks`` are rows of the tracker; ``measurements`` are all detections of the recorded run.
    """
    if not taken.num_rows:
        return
    detections = _by(measurements, "scan", "detection")
    positions = _by(tracks, "time_s", "track")
    rows = _sorted(taken)
    lines = [
        (when, positions[when, track], detections[scan, detection])
        for when, scan, track, detection in zip(
            *(rows[name].tolist() for name in ("time_s", "scan", "track", "detection")), strict=True
        )
        if (when, track) in positions
    ]
    strips = np.array([[a, b] for _, a, b in lines], dtype=float).reshape(-1, 2, 2)
    count = _counts(np.array([when for when, *_ in lines]), time)
    entity = path(*ASSOCIATIONS, tracker)
    style = rr.LineStrips2D.from_fields(colors=rgba(ASSOCIATION_COLOUR), radii=pixels(1.0), draw_order=33.0)
    stream.draw(entity, time, style, rr.LineStrips2D.columns(strips=strips), count=count)
    # Behind the dot of the detection, as a ring around it.
    ring = rr.Points2D.from_fields(colors=rgba(ASSOCIATION_COLOUR), radii=pixels(3.0), draw_order=19.0)
    used = path(*ASSOCIATIONS, tracker, "detections")
    stream.draw(used, time, ring, rr.Points2D.columns(positions=strips[:, 1]), count=count)


def send_gates(stream: Stream, tracker: str, gates: pa.Table, time: Array) -> None:
    """The outline of the gate of each track before the scans of each instant (s), in the track's colour."""
    rows = _sorted(gates)
    corner = np.flatnonzero((np.diff(rows["scan"], prepend=-1) != 0) | (np.diff(rows["track"], prepend=-1) != 0))
    strips = np.split(np.stack([rows["x_m"], rows["y_m"]], axis=1).astype(np.float32), corner[1:])
    colours = np.array([rgba(identity_colour(int(track))) for track in rows["track"][corner]], dtype=np.uint32)
    lines = rr.LineStrips2D.columns(strips=strips, colors=colours)
    style = rr.LineStrips2D.from_fields(radii=pixels(0.5), draw_order=24.0)
    count = _counts(rows["time_s"][corner], time)
    stream.draw(path(*ASSOCIATIONS, tracker, "gates"), time, style, lines, count=count)


def identity_colour(track: int) -> str:
    """The colour of an identity."""
    return IDENTITY_COLOURS[track % len(IDENTITY_COLOURS)]


def _outlines(rows: Columns) -> npt.NDArray[np.float32]:
    """``(rows, CORNERS, 2)`` m, the 95 % ellipses of position as closed lines: Rerun turns one ellipse an entity."""
    half, rotation = ellipse(rows["p_00"], rows["p_01"], rows["p_11"])
    angle = np.linspace(0, 2 * np.pi, CORNERS)
    along, across = half[:, :1] * np.cos(angle), half[:, 1:] * np.sin(angle)
    cosine, sine = np.cos(rotation)[:, None], np.sin(rotation)[:, None]
    x, y = along * cosine - across * sine, along * sine + across * cosine
    return np.stack([rows["px_m"][:, None] + x, rows["py_m"][:, None] + y], axis=2).astype(np.float32)


def _colours(rows: Columns) -> Indices:
    """``(rows,)`` RGBA of each track's identity, fainter where it states that it may not exist."""
    plain = np.array([rgba(identity_colour(number)) for number in range(len(IDENTITY_COLOURS))], dtype=np.uint32)
    existence = np.nan_to_num(rows["existence"], nan=1.0)
    alpha = np.round(255 * (FAINTEST + (1 - FAINTEST) * existence)).astype(np.uint32)
    opaque = plain[rows["track"].astype(int) % len(IDENTITY_COLOURS)]
    return np.asarray((opaque & 0xFFFFFF00) | alpha)


def _label(event: TrackEvent) -> str:
    if event.kind == "switched":
        return f"switched {event.other_track} to {event.track}"
    return f"{event.kind} {event.track}" if event.track is not None else event.kind


def _sorted(table: pa.Table) -> Columns:
    order = np.argsort(table["time_s"].to_numpy(), kind="stable")
    return {name: table[name].to_numpy()[order] for name in table.column_names if name != "tracker"}


def _counts(when: Array, time: Array) -> Indices:
    """``(instants,)`` how many rows there are at each instant."""
    return np.bincount(np.searchsorted(time, when - 1e-9), minlength=len(time))


def _by(table: pa.Table, *keys: str) -> Mapping[tuple[float, ...], tuple[float, float]]:
    """Position by some columns."""
    x, y = ("px_m", "py_m") if "px_m" in table.column_names else ("x_m", "y_m")
    numbers = (table[name].to_pylist() for name in keys)
    places = zip(table[x].to_pylist(), table[y].to_pylist(), strict=True)
    return dict(zip(zip(*numbers, strict=True), places, strict=True))
