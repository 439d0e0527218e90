"""The numbers of a run inside its recording, in full precision, so that it can be read back without the viewer.

What is drawn is rounded to single precision. The entity ``data`` keeps the summary as JSON and each table as Parquet.
"""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import rerun as rr

from trackbench.results import Result
from trackbench.subjects.recording.chunks import DATA, SUMMARY
from trackbench.subjects.recording.stream import Stream

#: The tables that are kept, with known and with hidden identities.
TABLES = {
    "known": (
        "truth", "measurements", "estimates", "recorded_nis", "steps", "nis", "modes", "recorded_modes", "roads",
    ),
    "hidden": (
        "truth", "measurements", "tracks", "taken", "due", "steps", "events", "objects", "association", "existence",
        "roads",
    ),
}  # fmt: skip


def send_data(stream: Stream, result: Result) -> None:
    """The summary and the tables; of the events those of the recorded run."""
    summary = json.dumps(result.json(), allow_nan=False, ensure_ascii=False)
    blobs = {name: _blob(_kept(result, name)) for name in TABLES[result.summary.identities]}
    components: dict[str, Any] = {SUMMARY: summary, **blobs}
    stream.static(DATA, rr.AnyValues(**components))


def tables_of(blobs: dict[str, bytes]) -> dict[str, pa.Table]:
    """The tables by name, out of their Parquet files.

    Raises:
        pyarrow.ArrowException: one of them is damaged.
    """
    return {name: pq.read_table(io.BytesIO(blob)) for name, blob in blobs.items()}


def _kept(result: Result, name: str) -> pa.Table:
    table = result.tables.if_there(name)
    if name == "events" and table.num_rows:
        table = table.filter(pc.equal(table["run"], float(result.summary.recorded_run)))
    return table


def _blob(table: pa.Table) -> Any:
    sink = io.BytesIO()
    pq.write_table(table, sink, compression="zstd")
    return np.frombuffer(sink.getvalue(), dtype=np.uint8)
