"""The numbers of a run inside its recording, in full precision, and a run read back from them.

What is drawn is rounded to single precision. The entity ``data`` keeps the summary as JSON and each table as Parquet.
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from importlib.metadata import version as version_of
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from trackbench.base.errors import InputError, similar_path_hint
from trackbench.base.files import require_regular
from trackbench.results import EXAMINATION, SUMMARY, Result, Tables, summary_of
from trackbench.results.declared import FUNCTION_TABLES
from trackbench.results.folder import require_table
from trackbench.subjects.recording.chunks import DATA, SUMMARY_COMPONENT, Unreadable, read_chunks

if TYPE_CHECKING:
    from trackbench.subjects.recording.stream import Stream

#: The tables that are kept, with known and with hidden identities; beside them those of functions.
TABLES = {
    "known": (
        "truth", "measurements", "estimates", "recorded_nis", "steps", "nis", "modes", "recorded_modes", "roads",
        "differences",
    ),
    "hidden": (
        "truth", "measurements", "tracks", "taken", "due", "steps", "events", "objects", "association", "existence",
        "roads", "differences",
    ),
}  # fmt: skip


def send_data(stream: Stream, result: Result) -> None:
    """The summary and the tables; of the events those of the recorded run."""
    # To read a run, this process need not wait for it.
    import rerun as rr

    components: dict[str, Any] = {SUMMARY_COMPONENT: json.dumps(result.json(), allow_nan=False, ensure_ascii=False)}
    own = [name for name in FUNCTION_TABLES if name in result.tables]
    for name in (*TABLES[result.summary.identities], *own):
        table = result.tables.if_there(name)
        if name == "events" and table.num_rows:
            table = table.filter(pc.equal(table["run"], float(result.summary.recorded_run)))
        sink = io.BytesIO()
        pq.write_table(table, sink, compression="zstd")
        components[name] = np.frombuffer(sink.getvalue(), dtype=np.uint8)
    stream.static(DATA, rr.AnyValues(**components))


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
    """With the tables of :data:`TABLES`; more from a folder."""
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
        summaries = [json.loads(run.pop(SUMMARY_COMPONENT)) for run in runs]
        tables = {name: pq.read_table(io.BytesIO(blob)) for name, blob in runs[0].items()} if runs else {}
    except (Unreadable, OSError, ValueError, pa.ArrowException) as error:
        if version == version_of("rerun-sdk"):
            cause = "cut off" if "exceeds file size" in str(error) else "damaged"
            raise InputError(f"this recording is {cause}: it cannot be read to its end", file=path) from error
        return _beside(
            path,
            f"it is of {f'Rerun {version}' if version else 'an early Rerun'}, "
            f"which Rerun {version_of('rerun-sdk')} cannot read",
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
        raise InputError(f"no such recording{similar_path_hint(path)}", file=path) from error
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
    if END not in tail and version == version_of("rerun-sdk"):
        raise InputError(CUT_OFF, file=path)
    return version


def _beside(path: Path, cause: str) -> Recorded:
    """The run from the tables in the folder of a recording.

    Raises:
        InputError: there are none.
    """
    if not (path.parent / SUMMARY).is_file():
        raise InputError(f"{cause}, and there is no {SUMMARY} beside it to read instead", file=path)
    return Recorded(Result.load(path.parent), path.parent, None, f"{path}: {cause}")
