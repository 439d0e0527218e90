"""Tracks for other tools: MOTChallenge text."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import pyarrow.compute as pc

from trackbench.base.errors import InputError
from trackbench.base.types import DUE, OPTIONAL, Array
from trackbench.metrics.function_events import drawn_instants
from trackbench.results import Result
from trackbench.results.columns import split

#: Of MOTChallenge: what is to be tracked, and what a track on is neither right nor wrong.
PEDESTRIAN, DISTRACTOR = 1, 8
#: Side of the square around each position over the cutoff. Centres that are half a cutoff apart along an axis then have
#: an intersection over union of a half: the threshold of TrackEval is that of CLEAR and the identity metrics here.
SIDE = 1.5


def exported(result: Result) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """The files of MOTChallenge: relative paths, each with a function that makes the content.

    Raises:
        InputError: identities are known in this result, or there is no truth.
    """
    if result.summary.identities == "known":
        raise InputError("mot needs a run with hidden identities, and those of this run are known", key="--format")
    if not result.summary.truth.known:
        raise InputError("mot needs a truth, and this recording has none", key="--format")
    name, time = result.name, drawn_instants(result.tables)
    yield f"mot/gt/{name}/gt/gt.txt", lambda: _lines(_objects(result, time))
    yield f"mot/gt/{name}/seqinfo.ini", lambda: _sequence(name, time)
    for tracker in result.summary.trackers:
        if tracker.failed is None:
            yield f"mot/trackers/{tracker.name}/data/{name}.txt", partial(_track_lines, result, tracker.name, time)


def _objects(result: Result, time: Array) -> Array:
    """Rows of frame, id, box, whether it counts, class and visibility."""
    truth = {name: rows for (name,), rows in split(result.tables.truth, "object").items()}
    rows = []
    for number, ((name,), due) in enumerate(split(result.tables.due, "object").items(), 1):
        there = due["status"] >= OPTIONAL
        step = np.searchsorted(truth[name]["time_s"], due["time_s"][there] - 1e-9)
        counts = due["status"][there] == DUE
        boxes = _boxes(result, truth[name]["px_m"][step], truth[name]["py_m"][step])
        kind = np.where(counts, PEDESTRIAN, DISTRACTOR)
        frame = np.searchsorted(time, due["time_s"][there] - 1e-9) + 1
        rows.append(np.column_stack([frame, np.full(len(frame), number), boxes, counts, kind, np.ones(len(frame))]))
    return _by_frame(rows, 9)


def _track_lines(result: Result, tracker: str, time: Array) -> bytes:
    """Rows of frame, id, box, existence probability and three columns without a meaning in the plane."""
    table = result.tables.tracks
    if not table.num_rows:
        return b""
    own = table.filter(pc.equal(table["tracker"], tracker))
    x, y, track, existence, when = (own[name].to_numpy() for name in ("px_m", "py_m", "track", "existence", "time_s"))
    frame = np.searchsorted(time, when - 1e-9) + 1
    confidence = np.nan_to_num(existence, nan=1.0)
    rest = np.full((len(frame), 3), -1.0)
    # Identities begin at 1 there.
    return _lines(_by_frame([np.column_stack([frame, track + 1, _boxes(result, x, y), confidence, rest])], 10))


def _boxes(result: Result, x: Array, y: Array) -> Array:
    """``(rows, 4)`` left, top, width and height of squares around positions, m."""
    side = SIDE * (result.summary.score.cutoff_m or 0.0)
    return np.column_stack([x - side / 2, y - side / 2, np.full((len(x), 2), side)])


def _by_frame(rows: list[Array], columns: int) -> Array:
    every = np.concatenate(rows) if rows else np.empty((0, columns))
    return every[np.argsort(every[:, 0], kind="stable")]


def _lines(rows: Array) -> bytes:
    return "".join(",".join(f"{value:.10g}" for value in row) + "\n" for row in rows).encode()


def _sequence(name: str, time: Array) -> bytes:
    rate = 1 / np.median(np.diff(time)) if len(time) > 1 else 1.0
    return f"[Sequence]\nname={name}\nframeRate={rate:.10g}\nseqLength={len(time)}\n".encode()
