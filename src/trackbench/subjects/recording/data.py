"""The numbers of a run inside its recording, in full precision, and a run read back from them or from its folder.

What is drawn is rounded to single precision. The entity ``data`` keeps the summary as JSON and each table as Parquet.
"""

from __future__ import annotations

import hashlib
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
from trackbench.results import EXAMINATION, Result, Tables, summary_of
from trackbench.results.declared import FUNCTION_TABLES
from trackbench.subjects.recording.chunks import DATA, SUMMARY_COMPONENT, Unreadable, read_chunks

if TYPE_CHECKING:
    from trackbench.subjects.recording.stream import Stream

#: The tables that are kept for ``inspect``, with known and with hidden identities; beside them those of functions.
TABLES = {
    "known": ("truth", "measurements", "estimates", "recorded_modes", "differences"),
    "hidden": ("truth", "measurements", "tracks", "due", "events", "objects", "differences"),
}
#: The name of a recording in the folder of its run.
RECORDING = "recording.rrd"
#: The first bytes of a file of this format of Rerun, which the version that wrote it follows, and some of the last.
MAGIC, END = b"RRF2", b"RRF2FOOT"


def send_data(stream: Stream, result: Result) -> None:
    """Send the summary and the tables; of the events those of the recorded run."""
    # To read a run, this process need not wait for it.
    import rerun as rr

    components: dict[str, Any] = {}
    own = [name for name in FUNCTION_TABLES if name in result.tables]
    for name in (*TABLES[result.summary.identities], *own):
        table = result.tables.if_there(name)
        if name == "events" and table.num_rows:
            table = table.filter(pc.equal(table["run"], float(result.summary.recorded_run)))
        sink = io.BytesIO()
        pq.write_table(table, sink, compression="zstd")
        components[name] = np.frombuffer(sink.getvalue(), dtype=np.uint8)
    digests = {name: hashlib.sha256(blob).hexdigest() for name, blob in components.items()}
    components[SUMMARY_COMPONENT] = json.dumps(
        {**result.json(), "tables": digests}, allow_nan=False, ensure_ascii=False
    )
    stream.static(DATA, rr.AnyValues(**components))


@dataclass(frozen=True)
class Recorded:
    """A run read back."""

    result: Result
    """The run, from a recording with the tables of :data:`TABLES` alone."""
    path: Path
    """The folder or the recording that was read."""
    recording: Path | None
    """The recording that the viewer can open; None where there is none."""

    @property
    def is_whole(self) -> bool:
        """Whether the tables are those of a folder, from which the recording can be written anew."""
        return self.path.is_dir()


def read(path: Path) -> Recorded:
    """Return the run of a folder, from its tables, or of a recording (.rrd).

    Raises:
        InputError: there is none, it is not whole or not one of trackbench, or Rerun cannot read it.
    """
    if (path if path.is_dir() else path.parent).joinpath(EXAMINATION).is_file():
        message = "this is an examination, not a run; `trackbench report` shows it, `trackbench view` its recording"
        raise InputError(message, file=path)
    if path.is_dir():
        file = path / RECORDING
        return Recorded(Result.load(path), path, file if file.is_file() and _is_current(file) else None)
    _require_recording(path)
    try:
        runs = read_chunks(path)
        summaries = [json.loads(run.pop(SUMMARY_COMPONENT)) for run in runs]
        digests = {name: hashlib.sha256(blob).hexdigest() for name, blob in runs[0].items()} if runs else {}
        tables = {name: pq.read_table(io.BytesIO(blob)) for name, blob in runs[0].items()} if runs else {}
    except (Unreadable, OSError, ValueError, pa.ArrowException) as error:
        problem = "this recording is cut off or damaged, or of another version of Rerun"
        message = f"{problem}: it cannot be read to its end; the folder of its run can be read instead"
        raise InputError(message, file=path) from error
    if len(summaries) != 1:
        raise InputError("this recording holds no run of trackbench", file=path)
    summary = summary_of(summaries[0], path)
    if summary.tables != digests:
        raise InputError("a table of this recording is not the one that its run wrote", file=path)
    return Recorded(Result(summary, Tables(tables)), path, path)


def _require_recording(path: Path) -> None:
    try:
        require_regular(path)
        head, tail = _ends(path)
    except FileNotFoundError as error:
        raise InputError(f"no such recording{similar_path_hint(path)}", file=path) from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error
    if not head.startswith(MAGIC):
        hint = "; a scenario is run first: `trackbench run`" if path.suffix in (".yaml", ".yml") else ""
        raise InputError(f"not a Rerun recording (.rrd){hint}", file=path)
    if _is_current(path) and END not in tail:
        raise InputError("this recording is cut off: its end is missing", file=path)


def _is_current(path: Path) -> bool:
    """Whether this version of Rerun wrote a file."""
    head, _ = _ends(path)
    return head.startswith(MAGIC) and ".".join(str(number) for number in head[4:7]) == version_of("rerun-sdk")


def _ends(path: Path) -> tuple[bytes, bytes]:
    with path.open("rb") as file:
        head = file.read(8)
        file.seek(max(0, file.seek(0, 2) - 12))
        return head, file.read()
