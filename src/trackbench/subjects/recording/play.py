"""Recordings made ready for the viewer: as they are, opened elsewhere, laid over each other, or anew from tables."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from trackbench.base.errors import InputError
from trackbench.results import EXAMINATION
from trackbench.subjects.recording import contents
from trackbench.subjects.recording.data import RECORDING, Recorded, read
from trackbench.subjects.recording.focus import Opening, focus_of
from trackbench.subjects.recording.writer import reopened, write, write_overlay


@dataclass(frozen=True)
class Playable:
    """Files that the viewer opens."""

    files: list[Path]
    notes: list[str]
    """What its user should know of how they came about."""
    time_s: float | None = None
    """Where it stops; None if it plays."""


@contextmanager
def playable(paths: Sequence[Path], opening: Opening) -> Iterator[Playable]:
    """Files for the viewer; those that had to be written are deleted at the end.

    Several runs of the same traffic become one file; those of different traffic stay apart.

    Args:
        paths: recordings or folders of runs.
        opening: where the viewer opens.

    Raises:
        InputError: one of them cannot be read or lacks what the viewer should open with.
    """
    examined = _examination(paths[0]) if len(paths) == 1 else None
    if examined is not None:
        if opening != Opening(at_s=opening.at_s):
            raise InputError("an examination has one target and is not scored by moments: give --at", file=paths[0])
        yield Playable([examined], [], opening.at_s)
        return
    runs = [read(path) for path in paths]
    notes = [f"{run.note}: shown from its tables" for run in runs if run.note]
    results = [run.result for run in runs]
    same = len(runs) == 1 or contents.same_traffic(results)
    if not same and opening != Opening(at_s=opening.at_s):
        raise InputError("these runs do not show the same traffic: give --at alone, or one run", file=paths[1])
    known = all(result.summary.identities == "known" for result in results)
    focus = focus_of(results, opening)
    with tempfile.TemporaryDirectory(prefix="trackbench-") as folder:
        names = contents.labels(paths)
        if len(runs) > 1 and same and known:
            file = Path(folder) / f"{' over '.join(names)}.rrd"
            write_overlay(contents.laid_over(dict(zip(names, results, strict=True))), file, focus)
            files = [file]
        else:
            files = [_file(run, Path(folder) / f"{number}.rrd", opening) for number, run in enumerate(runs)]
        if not same:
            notes.append("they do not show the same traffic: the viewer has them one beside the other, not laid over")
        elif len(runs) > 1 and not known:
            notes.append("their identities are hidden: the viewer has them one beside the other, not laid over")
        yield Playable(files, notes, focus.time_s)


def _file(run: Recorded, made: Path, opening: Opening) -> Path:
    """The run's own file if it opens where it should, or else one that is made."""
    focus = focus_of([run.result], opening)
    if run.rerun is None:
        write(run.result, made, focus=focus)
    elif focus.vehicle is not None or focus.tracker is not None:
        reopened(run.file, run.result, made, focus)
    else:
        return run.file
    return made


def _examination(path: Path) -> Path | None:
    """The recording of an examination by its file or its folder; None if it is something else."""
    file = path / RECORDING if path.is_dir() else path
    return file if file.is_file() and (file.parent / EXAMINATION).is_file() else None
