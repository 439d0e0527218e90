"""Search for the frame of external tracks, where almost none of them is near an object of the truth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath

import numpy as np

from trackbench.base.types import Truth
from trackbench.runner.external_run import NearestObject
from trackbench.runner.external_tracks import clock_shift, rows_of_run
from trackbench.runner.work import Work
from trackbench.truth.config.traffic import TracksConfig, files_in
from trackbench.truth.tracks import TrackRows

#: Share of rows near objects: below FEW other frames are tried; one with MANY is named to the user.
FEW, MANY = 0.1, 0.5
#: Other frames: the matrix (row by row) that turns x and y of the file into the truth's frame.
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
        work: data shared by all blocks; only the first run of each scene is checked.
        name: name of the tracker.
        matched_share: share of the objects' time in which a track is on them. A single file with a high share is not
            checked: its other tracks may follow traffic without a truth.
    """
    config, files = work.trackers[name], work.external_tracks[name]
    assert isinstance(config, TracksConfig)
    assert work.track_score is not None
    remarks = []
    for number, file_rows in enumerate(files):
        rows, truth = rows_of_run(file_rows, number, 0), work.scenes[number].truth
        shift = clock_shift(file_rows, truth, config.time_offset_s)
        doubtful = len(files) > 1 or matched_share < FEW
        why = why_nothing_matches(rows, truth, shift, work.track_score.cutoff) if doubtful else None
        where = f"{PurePath(files_in(config.path)[number]).name}: " if len(files) > 1 else ""
        remarks += [] if why is None else [where + why]
    return tuple(remarks)


def why_nothing_matches(rows: TrackRows, truth: Truth, shift: float, cutoff: float) -> str | None:
    """Say why almost no row of a file is near an object, and what to do; None where enough rows are.

    Args:
        rows: rows of one run in the file of tracks, in the order of time.
        truth: truth of the run's scene.
        shift: time to add to the time stamps of the rows, s.
        cutoff: distance from which a row is on no object, m.
    """
    nearest = NearestObject(rows, truth, 0, shift)
    if not len(nearest.stamp):
        return None

    def share(frame: Sequence[float]) -> float:
        return float((nearest.at(0.0, np.reshape(frame, (2, 2)))[1] < cutoff**2).mean())

    near = share((1, 0, 0, 1))
    if near >= FEW:
        return None
    shares = {name: share(frame) for name, frame in FRAMES.items()}
    best = max(shares, key=lambda name: shares[name])
    what = f"{100 * near:.1f} % of its rows are within {cutoff:g} m of an object"
    if shares[best] < MANY:
        return f"{what}: are the tracks of this recording, in its frame and in metres?"
    remedy = "; exchange their columns (--map)" if best == "x and y exchanged" else "; convert the file"
    return f"{what}; with {best} {100 * shares[best]:.0f} % would be{remedy}"
