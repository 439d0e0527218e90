"""The tracks seen from above: dots, ellipses, trails and rings; with hidden identities events, gates and associations.

With known identities a tracker's estimates of the vehicles are drawn as tracks in the tracker's colour. With hidden
identities each track has a number and a colour of its own.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pyarrow as pa
import rerun as rr

from trackbench.base.types import Array
from trackbench.document.palette import ERROR_COLOURS, IDENTITY_COLOURS
from trackbench.metrics.function_events import TrackEvent
from trackbench.metrics.recorded_run import table_frame
from trackbench.results.columns import Columns, split
from trackbench.subjects.recording.scene import TRAIL_S, TRAILS, TRUE_TRAILS, WORLD, send_trail
from trackbench.subjects.recording.stream import Colours, Stream, counts, outlines, path, pixels, rgba, rgba_of

TRACKS = (*WORLD, "tracks")
COVARIANCES = (*WORLD, "covariances")
TRACK_TRAILS = (*TRAILS, "tracks")
MISSES = (*WORLD, "misses")
MARKS = (*WORLD, "marks")
ASSOCIATIONS = (*WORLD, "associations")
#: Duration of an event's mark, s.
MARKED_S = 1.0
#: Colour of each kind of event that is marked; a birth or confirmation needs no mark, since a trail begins there.
MARKED = {"switched": "#FFFFFF", "merged": ERROR_COLOURS[2], "lost": ERROR_COLOURS[2], "false": ERROR_COLOURS[1]}
MISSED = ERROR_COLOURS[2]
#: Radius of the ring around a vehicle without a track, m.
MISS_RADIUS = 3.0
ASSOCIATION_COLOUR = "#FFFFFF"
#: Opacity of a track with existence probability 0.
FAINTEST = 0.2


def trails(trackers: Iterable[str]) -> dict[str, float]:
    """Return the duration, s, for which a view shows each trail (path of the last seconds), by entity."""
    return dict.fromkeys([path(*TRUE_TRAILS), *(path(*TRACK_TRAILS, name) for name in trackers)], TRAIL_S)


def entities_of_tracker(tracker: str) -> dict[str, float]:
    """Return the duration, s, for which a view of one tracker shows each entity; 0 shows the latest instant alone."""
    return {
        path(*TRACKS, tracker): 0.0,
        path(*COVARIANCES, tracker): 0.0,
        path(*TRACK_TRAILS, tracker): TRAIL_S,
        path(*MISSES, tracker): 0.0,
        path(*MARKS, tracker): MARKED_S,
    }


def tracker_families() -> list[str]:
    """Return the entities that have a child for each tracker; a view of one tracker hides all other children."""
    return [path(*family) for family in (TRACKS, COVARIANCES, TRACK_TRAILS, MISSES, MARKS, ASSOCIATIONS)]


def send_tracks(stream: Stream, tracker: str, tracks: Columns, time: Array, colour: str | None = None) -> None:
    """Send one tracker's tracks at all instants (s), with 95 % ellipses and trails.

    Args:
        stream: the recording.
        tracker: name of the tracker.
        tracks: the tracker's rows of table ``estimates`` or ``tracks``, in the order of time.
        time: all instants ``(instants,)``, s.
        colour: the tracker's colour; None with hidden identities, where each track has its own.
    """
    known = np.isfinite(tracks["px_m"])
    rows = {name: values[known] for name, values in tracks.items()}
    hidden = colour is None
    colours = np.full(len(rows["time_s"]), rgba(colour), dtype=np.uint32) if colour else _identity_colours(rows)
    labels = [f"{int(track)}" for track in rows["track"]] if hidden else None
    count = counts(rows["time_s"], time)
    at = np.stack([rows["px_m"], rows["py_m"]], axis=1)
    points = rr.Points2D.columns(positions=at, colors=colours, labels=labels)
    style = rr.Points2D.from_fields(radii=pixels(2.5), draw_order=30.0, show_labels=hidden)
    stream.draw(path(*TRACKS, tracker), time, style, points, count=count)
    ellipses = rr.LineStrips2D.columns(strips=outlines(at, rows["p_00"], rows["p_01"], rows["p_11"]), colors=colours)
    thin = rr.LineStrips2D.from_fields(radii=pixels(0.75), draw_order=25.0)
    stream.draw(path(*COVARIANCES, tracker), time, thin, ellipses, count=count)
    identity = rows["track" if hidden else "object"]
    send_trail(stream, path(*TRACK_TRAILS, tracker), time, rows, identity, colours, 1.2 if hidden else 0.5)


def send_misses(stream: Stream, tracker: str, objects: pa.Table, truth: pa.Table, time: Array) -> None:
    """Send a ring around each vehicle that should have a track and has none, at all instants (s).

    ``objects`` has the tracker's rows of the table ``objects``.
    """
    vehicles = {name: rows for (name,), rows in split(truth, "object").items()}
    parts = [np.empty((0, 3))]
    for (name, state), states in split(objects, "object", "state").items():
        if state in ("waiting", "lost"):
            start, until = states["time_s"][:, None], states["until_s"][:, None]
            times = time[((time >= start - 1e-9) & (time < until - 1e-9)).any(axis=0)]
            step = np.searchsorted(vehicles[name]["time_s"], times - 1e-9)
            parts.append(np.stack([times, vehicles[name]["px_m"][step], vehicles[name]["py_m"][step]], axis=1))
    positions = np.concatenate(parts)
    positions = positions[np.argsort(positions[:, 0], kind="stable")]
    rings = rr.Ellipses2D.columns(half_sizes=np.full((len(positions), 2), MISS_RADIUS), centers=positions[:, 1:])
    style = rr.Ellipses2D.from_fields(colors=rgba(MISSED), line_radii=pixels(1.5), draw_order=35.0)
    stream.draw(path(*MISSES, tracker), time, style, rings, count=counts(positions[:, 0], time))


def send_marks(stream: Stream, tracker: str, events: Iterable[TrackEvent]) -> None:
    """Send a mark at each switch, loss and beginning of a false track."""
    shown = [event for event in events if event.kind in MARKED]
    if not shown:
        return
    time, count = np.unique([event.time_s for event in shown], return_counts=True)
    at = np.array([(event.x_m, event.y_m) for event in shown])
    colours = rgba_of(MARKED[event.kind] for event in shown)
    style = rr.Points2D.from_fields(radii=pixels(5.0), draw_order=38.0)
    points = rr.Points2D.columns(positions=at, colors=colours)
    stream.draw(path(*MARKS, tracker), time, style, points, count=count)


def send_associations(
    stream: Stream, tracker: str, taken: pa.Table, tracks: pa.Table, measurements: pa.Table, time: Array
) -> None:
    """Send a line from each track to its associated detection, at all instants (s).

    ``taken`` and ``tracks`` are the tracker's rows; ``measurements`` has all detections of the recorded run.
    """
    detections = table_frame(measurements)[["scan", "detection", "x_m", "y_m"]]
    pairs = table_frame(taken).merge(table_frame(tracks), on=["time_s", "track"])
    pairs = pairs.merge(detections, on=["scan", "detection"]).sort_values("time_s", kind="stable")
    strips = pairs[["px_m", "py_m", "x_m", "y_m"]].to_numpy().reshape(-1, 2, 2)
    count = counts(pairs["time_s"].to_numpy(), time)
    entity = path(*ASSOCIATIONS, tracker)
    style = rr.LineStrips2D.from_fields(colors=rgba(ASSOCIATION_COLOUR), radii=pixels(1.0), draw_order=33.0)
    stream.draw(entity, time, style, rr.LineStrips2D.columns(strips=strips), count=count)


def send_gates(stream: Stream, tracker: str, rows: Columns, time: Array) -> None:
    """Send the outline of each track's gate at each instant (s), in the track's colour."""
    first = np.flatnonzero((np.diff(rows["scan"], prepend=-1) != 0) | (np.diff(rows["track"], prepend=-1) != 0))
    strips = np.split(np.stack([rows["x_m"], rows["y_m"]], axis=1).astype(np.float32), first[1:])
    colours = _opaque_colours(rows["track"][first])
    lines = rr.LineStrips2D.columns(strips=strips, colors=colours)
    style = rr.LineStrips2D.from_fields(radii=pixels(0.5), draw_order=24.0)
    count = counts(rows["time_s"][first], time)
    stream.draw(path(*ASSOCIATIONS, tracker, "gates"), time, style, lines, count=count)


def _opaque_colours(identity: Array) -> Colours:
    return np.asarray(rgba_of(IDENTITY_COLOURS)[identity.astype(int) % len(IDENTITY_COLOURS)])


def _identity_colours(rows: Columns) -> Colours:
    """Return the RGBA colour of each row's track, ``(rows,)``, fainter for a smaller existence probability."""
    existence = np.nan_to_num(rows["existence"], nan=1.0)
    alpha = np.round(255 * (FAINTEST + (1 - FAINTEST) * existence)).astype(np.uint32)
    return np.asarray((_opaque_colours(rows["track"]) & 0xFFFFFF00) | alpha)
