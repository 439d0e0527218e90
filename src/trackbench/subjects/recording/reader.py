"""Reads a run back from its recording, or from the tables beside one that cannot be read here."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import rerun as rr

from trackbench.base.errors import InputError
from trackbench.base.files import require_regular
from trackbench.results import EXAMINATION, SUMMARY, Result, Tables, summary_of
from trackbench.results.table_check import require_table
from trackbench.subjects.recording.chunks import SUMMARY as COMPONENT
from trackbench.subjects.recording.chunks import Unreadable, read_chunks
from trackbench.subjects.recording.data import tables_of

#: The name of a recording in the folder of its run.
RECORDING = "recording.rrd"
#: How a file of Rerun begins: four letters, then the version that wrote it;
#: the fourth letter of early versions is another one.
MAGIC, NOW = b"RRF", b"RRF2"
#: What the last bytes of a whole file hold.
END = b"RRF2FOOT"
END_BYTES = 12
CUT_OFF = "this recording is cut off: its end is missing"


@dataclass(frozen=True)
class Recorded:
    """A run read back."""

    result: Result
    """With the tables of :data:`trackbench.subjects.recording.data.TABLES`; more from a folder."""
    file: Path
    """What was read: a recording or the folder of a run."""
    rerun: str | None
    """The version of Rerun that wrote the recording; None if it was not read."""
    note: str | None = None
    """Why the tables were read in place of the recording."""


def read(path: Path) -> Recorded:
    """The run of a recording (.rrd) or of a folder.

    Raises:
        InputError: there is none, it is not whole, it is not one of trackbench, or it is of a version of Rerun that
            cannot be read here and has no tables beside it.
    """
    if (path if path.is_dir() else path.parent).joinpath(EXAMINATION).is_file():
        message = "this is an examination, not a run; `trackbench report` shows it, `trackbench view` its recording"
        raise InputError(message, file=path)
    if path.is_dir():
        if (path / RECORDING).exists():
            return read(path / RECORDING)
        return Recorded(Result.load(path), path, None, "there is no recording in this folder")
    version = _version(path)
    try:
        runs = read_chunks(path)
        summaries = [json.loads(run.pop(COMPONENT)) for run in runs]
        tables = tables_of(runs[0]) if runs else {}
    except (Unreadable, OSError, ValueError, pa.ArrowException) as error:
        if version == rr.__version__:
            cause = "cut off" if "exceeds file size" in str(error) else "damaged"
            raise InputError(f"this recording is {cause}: it cannot be read to its end", file=path) from error
        return _beside(
            path,
            f"it is of {f'Rerun {version}' if version else 'an early Rerun'}, which Rerun {rr.__version__} cannot read",
        )
    if len(summaries) != 1:
        return _beside(path, "it holds no run of trackbench, or several that are laid over each other")
    summary = summary_of(summaries[0], path)
    for name, table in tables.items():
        require_table(name, table, summary.layout, path)
    return Recorded(Result(summary, Tables(tables)), path, version)


def _version(path: Path) -> str | None:
    """The version of Rerun that wrote a file; None if it is one that did not say so in this way.

    Raises:
        InputError: it is no whole recording.
    """
    try:
        require_regular(path)
        with path.open("rb") as file:
            head = file.read(8)
            size = file.seek(0, 2)
            file.seek(max(0, size - END_BYTES))
            tail = file.read()
    except FileNotFoundError as error:
        raise InputError("no such recording", file=path) from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error
    if not head.startswith(MAGIC):
        hint = "; a scenario is run first: `trackbench run`" if path.suffix in (".yaml", ".yml") else ""
        raise InputError(f"not a Rerun recording (.rrd){hint}", file=path)
    if size < len(NOW) + END_BYTES:
        raise InputError(CUT_OFF, file=path)
    if not head.startswith(NOW):
        return None
    version = ".".join(str(number) for number in head[4:7])
    if END not in tail and version == rr.__version__:
        raise InputError(CUT_OFF, file=path)
    return version


def _beside(path: Path, cause: str) -> Recorded:
    """The run from the tables in the folder of a recording.

    Raises:
        InputError: there are none.
    """
    folder = path.parent
    if not (folder / SUMMARY).is_file():
        raise InputError(f"{cause}, and there is no {SUMMARY} beside it to read instead", file=path)
    return Recorded(Result.load(folder), folder, None, f"{path}: {cause}")
