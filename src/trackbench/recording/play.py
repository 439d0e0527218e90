"""Recordings made ready for the viewer: as they are, laid over each other, or written anew from tables."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from trackbench.recording import overlay
from trackbench.recording.moments import require_time
from trackbench.recording.reader import RECORDING, read
from trackbench.recording.writer import write, write_overlay
from trackbench.results import EXAMINATION


@dataclass(frozen=True)
class Playable:
    """Files that the viewer opens."""

    files: list[Path]
    notes: list[str]
    """What its user should know of how they came about."""


@contextmanager
def playable(paths: Sequence[Path], at: float | None = None) -> Iterator[Playable]:
    """Files for the viewer; those that had to be written are deleted at the end.

    Several runs of the same traffic become one file; those of different traffic stay apart.

    Args:
        paths: recordings or folders of runs.
        at: a time that all of them must have, s.

    Raises:
        InputError: one of them cannot be read or lacks that time.
    """
    examined = _examination(paths[0]) if len(paths) == 1 else None
    if examined is not None:
        yield Playable([examined], [])
        return
    runs = [read(path) for path in paths]
    for run in runs:
        if at is not None:
            require_time(0.0, run.result.summary.truth.duration_s, at)
    notes = [f"{run.note}: shown from its tables" for run in runs if run.note]
    names = overlay.labels(paths)
    with tempfile.TemporaryDirectory(prefix="trackbench-") as folder:
        results = [run.result for run in runs]
        if len(runs) > 1 and overlay.same_traffic(results):
            file = Path(folder) / f"{' over '.join(names)}.rrd"
            write_overlay(overlay.laid_over(dict(zip(names, results, strict=True))), file)
            yield Playable([file], notes)
            return
        if len(runs) > 1:
            notes.append("they do not show the same traffic: the viewer has them one beside the other, not laid over")
        files = []
        for number, run in enumerate(runs):
            file = run.file
            if run.rerun is None:
                file = Path(folder) / f"{number}.rrd"
                write(run.result, file)
            files.append(file)
        yield Playable(files, notes)


def _examination(path: Path) -> Path | None:
    """The recording of an examination by its file or its folder; None if it is something else."""
    file = path / RECORDING if path.is_dir() else path
    return file if file.is_file() and (file.parent / EXAMINATION).is_file() else None
