"""Whether tracks of another program are in the frame of the truth, where almost none of them is on an object."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath

import numpy as np

from trackbench.base.types import Truth
from trackbench.runner.filed_run import NearestObject
from trackbench.runner.filed_tracks import clock_shift, rows_of_run
from trackbench.runner.work import Work
from trackbench.truth.config.traffic import TracksConfig, files_in
from trackbench.truth.tracks import TrackRows

#: Share of the rows on objects below which other frames are tried, and from which one of them is named.
FEW, MANY = 0.1, 0.5
#: Other frames: what x and y would be in the truth's.
FRAMES = {
    "x and y exchanged": (0, 1, 1, 0),
    "x = -y, y = x (turned by 90 degrees)": (0, -1, 1, 0),
    "x = y, y = -x (turned by -90 degrees)": (0, 1, -1, 0),
    "x = -x, y = -y (turned by 180 degrees)": (-1, 0, 0, -1),
    "y = -y (y to the other side)": (1, 0, 0, -1),
    "x = -x (x to the other side)": (-1, 0, 0, 1),
    "x = -y, y = -x": (0, -1, -1, 0),
}


def remarks_on_files(work: Work, name: str, matched_share: float) -> tuple[str, ...]:
    """Say where the files of a tracker contradict the truth, and what to do about it.

    Args:
        work: of the run; of each scene the first run is looked at.
        name: of the tracker.
        matched_share: of its objects; where a single file has enough, its other tracks may be of other traffic.
    """
    config, files = work.trackers[name], work.filed[name]
    assert isinstance(config, TracksConfig)
    assert work.track_score is not None
    remarks = []
    for number, every in enumerate(files):
        rows, truth = rows_of_run(every, number, 0), work.scenes[number].truth
        shift = clock_shift(every, truth, config.time_offset_s)
        doubtful = len(files) > 1 or matched_share < FEW
        why = why_nothing_matches(rows, truth, shift, work.track_score.cutoff) if doubtful else None
        where = f"{PurePath(files_in(config.path)[number]).name}: " if len(files) > 1 else ""
        remarks += [] if why is None else [where + why]
    return tuple(remarks)


def why_nothing_matches(rows: TrackRows, truth: Truth, shift: float, cutoff: float) -> str | None:
    """Say why almost no row is on an object, and what to do; None where enough are.

    Args:
        rows: of one run, in the order of time.
        truth: of its scene.
        shift: added to the rows' times, s.
        cutoff: distance at which a row is on no object, m.
    """
    nearest = NearestObject(rows, truth, 0, shift)
    if not len(nearest.stamp):
        return None

    def share(frame: Sequence[float]) -> float:
        return float((nearest.at(0.0, np.reshape(frame, (2, 2)))[1] < cutoff**2).mean())

    near = share((1, 0, 0, 1))
    if near >= FEW:
        return None
    others = {name: share(frame) for name, frame in FRAMES.items()}
    best = max(others, key=lambda name: others[name])
    what = f"{100 * near:.1f} % of its rows are within {cutoff:g} m of an object"
    if others[best] < MANY:
        return f"{what}: are the tracks of this recording, in its frame and in metres?"
    remedy = "; exchange their columns (--map)" if best == "x and y exchanged" else "; convert the file"
    return f"{what}; with {best} {100 * others[best]:.0f} % would be{remedy}"
