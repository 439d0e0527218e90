"""Trails: the last seconds of the true paths and of the estimates, as lines in the fixed frame."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import pyarrow as pa
import rerun as rr

from trackbench.document.palette import TRUTH_COLOUR
from trackbench.results.columns import Columns, split
from trackbench.subjects.recording.scene import WORLD
from trackbench.subjects.recording.stream import Stream, path, pixels, rgba

#: Length of a trail, s.
TRAIL_S = 2.0
TRUE = (*WORLD, "trails", "truth")
ESTIMATED = (*WORLD, "trails", "estimates")


def trails(trackers: Iterable[str]) -> list[str]:
    """The entities, which a view shows over the length of a trail."""
    return [path(*TRUE), *(path(*ESTIMATED, tracker) for tracker in trackers)]


def send_trails(stream: Stream, truth: pa.Table, estimates: pa.Table, colours: Mapping[str, str], hold: float) -> None:
    """At each instant the piece of line from the one before; a view puts them together.

    Args:
        stream: the recording.
        truth: table of the recorded run.
        estimates: table of all trackers.
        colours: by tracker.
        hold: the longest time between two estimates that are joined, s.
    """
    send_true_trails(stream, truth, hold)
    by_tracker: dict[str, list[Columns]] = {}
    for (tracker, _), rows in split(estimates, "tracker", "object").items():
        by_tracker.setdefault(tracker, []).append(rows)
    for number, (tracker, tracks) in enumerate(by_tracker.items()):
        _send(stream, path(*ESTIMATED, tracker), tracks, colours[tracker], 0.5, 10.0 + 0.1 * number, hold)


def send_true_trails(stream: Stream, truth: pa.Table, hold: float) -> None:
    """Those of the vehicles."""
    vehicles = [_alive(rows) for rows in split(truth, "object").values()]
    _send(stream, path(*TRUE), vehicles, TRUTH_COLOUR, 1.0, 1.0, hold)


def _alive(rows: Columns) -> Columns:
    alive = rows["alive"].astype(bool)
    return {name: values[alive] for name, values in rows.items()}


def _send(
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
    lines = rr.LineStrips2D.columns(strips=strips[order_of_time])
    stream.columns(entity, time, lines.partition(count))
    stream.static(entity, rr.LineStrips2D.from_fields(colors=rgba(colour), radii=pixels(size), draw_order=order))
