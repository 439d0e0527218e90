"""The data of a run inside its recording, and the reading of a run from a recording or a folder.

Drawings have single precision. The entity ``data`` keeps the summary as JSON and tables as Parquet in full precision.
"""

from __future__ import annotations

import io
import json
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from importlib.metadata import version as version_of
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from trackbench.base.errors import InputError, similar_path_hint
from trackbench.base.files import require_regular
from trackbench.results import SCHEMA_VERSION, Result, Summary, Tables
from trackbench.results.metric_value import model_of

if TYPE_CHECKING:
    from trackbench.subjects.recording.stream import Stream

#: Tables that a recording stores for ``inspect``, by kind of identities; tables of functions are stored as well.
TABLES = {
    "known": ("truth", "estimates", "differences"),
    "hidden": ("truth", "tracks", "due", "events", "objects", "differences"),
}
#: Entity with the data of a run, and its component with the summary; each other component is a table.
DATA, SUMMARY_COMPONENT = "/data", "summary"
#: Name of the recording in the folder of a run.
RECORDING = "recording.rrd"
#: First bytes of a recording; the version of Rerun that wrote it follows.
MAGIC = b"RRF2"


def send_data(stream: Stream, result: Result, tables: Tables) -> None:
    """Send the summary and the tables that ``inspect`` needs, with the events of the recorded run alone."""
    # Imported late, since reading a run does not need it.
    import rerun as rr

    components: dict[str, Any] = {}
    function_tables = [name for name in ("decisions", "function_events") if name in tables]
    for name in (*TABLES[result.summary.identities], *function_tables):
        table = tables.if_there(name)
        if name == "events" and table.num_rows:
            table = table.filter(pc.equal(table["run"], float(result.summary.recorded_run)))
        sink = io.BytesIO()
        pq.write_table(table, sink, compression="zstd")
        components[name] = np.frombuffer(sink.getvalue(), dtype=np.uint8)
    components[SUMMARY_COMPONENT] = json.dumps(result.json(), allow_nan=False, ensure_ascii=False)
    stream.static(DATA, rr.AnyValues(**components))


@dataclass(frozen=True)
class Recorded:
    """Run that was read from a folder or a recording."""

    result: Result
    """Result of the run; read from a recording it has only the tables of :data:`TABLES`."""
    path: Path
    """Folder or recording that was read."""
    recording: Path | None
    """Recording that the viewer can open; None where there is none."""


def read(path: Path) -> Recorded:
    """Read a run from its folder or from its recording (.rrd).

    Raises:
        InputError: the path has no run of trackbench, or the recording is damaged or unreadable for Rerun.
    """
    if path.is_dir():
        file = path / RECORDING
        return Recorded(Result.load(path), path, file if file.is_file() and _is_current(file) else None)
    _require_recording(path)
    try:
        # Rerun's reader ends its process on some damaged files, with a message on stderr.
        with ProcessPoolExecutor(1, get_context("spawn"), os.close, (2,)) as pool:
            data = pool.submit(read_data, path).result()
        summary = json.loads(data.pop(SUMMARY_COMPONENT)) if data else None
        tables = {name: pq.read_table(io.BytesIO(blob)) for name, blob in data.items()}
    except (RuntimeError, OSError, ValueError, LookupError, pa.ArrowException) as error:
        problem = "this recording is cut off or damaged, or of another version of Rerun"
        message = f"{problem}: it cannot be read to its end; the folder of its run can be read instead"
        raise InputError(message, file=path) from error
    if summary is None:
        raise InputError("this recording holds no run of trackbench", file=path)
    return Recorded(Result(model_of(Summary, summary, path, "result", SCHEMA_VERSION), Tables(tables)), path, path)


def read_data(path: Path) -> dict[str, bytes]:
    """Return the components of the data entity by name; empty for another program's recording."""
    # rerun.chunk.RrdReader uses this reader; importing rerun takes longer than reading a recording.
    from rerun_bindings import RrdReaderInternal

    reader = RrdReaderInternal(str(path))
    chunks = reader.stream() if any(entry.kind == "recording" for entry in reader.store_entries()) else ()
    # All chunks are read, so that a damaged one is noticed.
    batches = [chunk.to_record_batch() for chunk in chunks if chunk.entity_path == DATA and chunk.is_static]
    return {
        name: str(values[0]).encode() if str(values.type) == "string" else values.to_numpy().tobytes()
        for batch in batches
        for name in batch.schema.names
        if "RowId" not in name
        for values in [batch.column(name)[0].values]
    }


def _require_recording(path: Path) -> None:
    try:
        require_regular(path)
        head = _head(path)
    except FileNotFoundError as error:
        raise InputError(f"no such recording{similar_path_hint(path)}", file=path) from error
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path) from error
    if not head.startswith(MAGIC):
        hint = "; a scenario is run first: `trackbench run`" if path.suffix in (".yaml", ".yml") else ""
        raise InputError(f"not a Rerun recording (.rrd){hint}", file=path)


def _is_current(path: Path) -> bool:
    """Return whether the installed version of Rerun wrote a file."""
    head = _head(path)
    return head.startswith(MAGIC) and ".".join(map(str, head[4:7])) == version_of("rerun-sdk")


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(7)
