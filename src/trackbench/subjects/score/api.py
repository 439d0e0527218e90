"""Tracks scored from Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from trackbench.api.result import ReportableResult
from trackbench.api.run import run
from trackbench.base.files import write_whole
from trackbench.subjects.score.scenario import FileOptions, scoring_scenario


def score(
    tracks: Path | str | Sequence[Path | str],
    truth: Path | str | Sequence[Path | str],
    *,
    columns: Mapping[str, str] | None = None,
    format: str | None = None,
    truth_format: str | None = None,
    rate_hz: float | None = None,
    time_offset_s: float = 0.0,
    out: Path | str | None = None,
) -> ReportableResult:
    """Score tracks that other programs wrote against the boxes of a file.

    Args:
        tracks: a file, or several, each of which is a tracker by its name. With several files of boxes: one file of
            tracks for each, or a folder of them; several folders are several trackers.
        truth: the file of boxes, of the same clock; or the files of several sequences, or a folder of them. Files of
            boxes and tracks belong together by their names.
        columns: the column of some keys, where its name does not tell: ``{"x": "pos_x", "time": "stamp:ns"}``.
        format: of the files; by the ending of each unless given.
        truth_format: of the file of boxes, where it is not that of the tracks.
        rate_hz: frames per second of files that count frames, Hz.
        time_offset_s: added to the time stamps of the tracks, s.
        out: a folder in which the result gets one, beside the scenario that it is. Nothing is written unless given.

    Raises:
        InputError: a file cannot be read or has no partner, or it is not known what its columns are.
    """
    files, boxes = (
        [Path(file) for file in ([places] if isinstance(places, Path | str) else places)] for places in (tracks, truth)
    )
    options = FileOptions(list((columns or {}).items()), format, rate_hz, truth_format)
    folder = Path() if out is None else Path(out)
    loaded = scoring_scenario(files, boxes, options, folder, time_offset_s=time_offset_s)
    if out is not None:
        write_whole(loaded.path, loaded.text.encode())
    return run(loaded, out=out)
