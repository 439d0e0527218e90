"""Ground truth and tracks as MOTChallenge text, for other tools."""

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

#: Classes of MOTChallenge: objects to be tracked, and objects on which a track is neither right nor wrong.
PEDESTRIAN, DISTRACTOR = 1, 8
#: Side of the square around each position, in cutoffs. Squares half a cutoff apart along an axis then have an
#: intersection over union of 0.5, so TrackEval's threshold is half a cutoff, as in CLEAR and the identity metrics here.
SIDE = 1.5


def mot_files(result: Result) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Yield the relative path of each MOTChallenge file, with a function that returns its content.

    Raises:
        InputError: identities are known, or there is no truth.
    """
    if result.summary.identities == "known":
        raise InputError("mot needs a run with hidden identities", key="--format")
    if not result.summary.truth.known:
        raise InputError("mot needs a ground truth, which this recording does not have", key="--format")
    name, time = result.name, drawn_instants(result.tables)
    yield f"mot/gt/{name}/gt/gt.txt", lambda: _lines(_objects(result, time))
    yield f"mot/gt/{name}/seqinfo.ini", lambda: _sequence(name, time)
    for tracker in result.summary.trackers:
        if tracker.failed is None:
            yield f"mot/trackers/{tracker.name}/data/{name}.txt", partial(_track_lines, result, tracker.name, time)


def _objects(result: Result, time: Array) -> Array:
    """Return MOTChallenge rows of the truth: frame number, id, box, whether it must be tracked, class, visibility."""
    truth = {name: rows for (name,), rows in split(result.tables.truth, "object").items()}
    rows = []
    for number, ((name,), due) in enumerate(split(result.tables.due, "object").items(), 1):
        is_listed = due["status"] >= OPTIONAL
        step = np.searchsorted(truth[name]["time_s"], due["time_s"][is_listed] - 1e-9)
        counts = due["status"][is_listed] == DUE
        boxes = _boxes(result, truth[name]["px_m"][step], truth[name]["py_m"][step])
        kind = np.where(counts, PEDESTRIAN, DISTRACTOR)
        frame = np.searchsorted(time, due["time_s"][is_listed] - 1e-9) + 1
        rows.append(np.column_stack([frame, np.full(len(frame), number), boxes, counts, kind, np.ones(len(frame))]))
    return _by_frame(rows, 9)


def _track_lines(result: Result, tracker: str, time: Array) -> bytes:
    """Return MOTChallenge lines of a tracker: frame number, id, box, existence probability, three unused columns."""
    table = result.tables.tracks
    if not table.num_rows:
        return b""
    rows = table.filter(pc.equal(table["tracker"], tracker))
    x, y, track, existence, when = (rows[name].to_numpy() for name in ("px_m", "py_m", "track", "existence", "time_s"))
    frame = np.searchsorted(time, when - 1e-9) + 1
    confidence = np.nan_to_num(existence, nan=1.0)
    unused = np.full((len(frame), 3), -1.0)
    # MOTChallenge's identities begin at 1.
    return _lines(_by_frame([np.column_stack([frame, track + 1, _boxes(result, x, y), confidence, unused])], 10))


def _boxes(result: Result, x: Array, y: Array) -> Array:
    """Return equal squares around positions: left, top, width and height, ``(rows, 4)`` m."""
    side = SIDE * (result.summary.score.cutoff_m or 0.0)
    return np.column_stack([x - side / 2, y - side / 2, np.full((len(x), 2), side)])


def _by_frame(rows: list[Array], columns: int) -> Array:
    table = np.concatenate(rows) if rows else np.empty((0, columns))
    return table[np.argsort(table[:, 0], kind="stable")]


def _lines(rows: Array) -> bytes:
    return "".join(",".join(f"{value:.10g}" for value in row) + "\n" for row in rows).encode()


def _sequence(name: str, time: Array) -> bytes:
    rate = 1 / np.median(np.diff(time)) if len(time) > 1 else 1.0
    return f"[Sequence]\nname={name}\nframeRate={rate:.10g}\nseqLength={len(time)}\n".encode()
