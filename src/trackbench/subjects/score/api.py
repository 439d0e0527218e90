"""The call ``trackbench.score``."""

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
        tracks: one file for each tracker, which is named after the file. With several files of boxes: one file of
            tracks for each, or a folder of them; several folders are several trackers.
        truth: file of boxes, by the same clock as the tracks; or the files, or the folder, of several sequences. Files
            of boxes and tracks are paired by name.
        columns: columns of keys whose column has no usual name: ``{"x": "pos_x", "time": "stamp:ns"}``.
        format: format of all files; None for a format by each file's ending.
        truth_format: format of the boxes, if it differs from the format of the tracks.
        rate_hz: frames per second of files that count frames, Hz.
        time_offset_s: time that is added to the time stamps of the tracks, s.
        out: folder for the result's folder and the scenario; None writes nothing.

    Raises:
        InputError: a file cannot be read or has no partner, or its columns are unknown.
    """
    files, boxes = (
        [Path(file) for file in ([paths] if isinstance(paths, Path | str) else paths)] for paths in (tracks, truth)
    )
    options = FileOptions(list((columns or {}).items()), format, rate_hz, truth_format)
    folder = Path() if out is None else Path(out)
    loaded = scoring_scenario(files, boxes, options, folder, time_offset_s=time_offset_s)
    if out is not None:
        write_whole(loaded.path, loaded.text.encode())
    return run(loaded, out=out)
