"""The data of a recording, read by a process of its own: Rerun's reader ends its process over some damaged files.

The process runs this file by its path, and the file imports nothing of trackbench: it starts in a third of the time.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import warnings
from pathlib import Path

#: The entity with the data of a run, and its component with the summary; the others are its tables.
DATA, SUMMARY_COMPONENT = "/data", "summary"
#: For how long a recording may be read, s.
PATIENCE = 300


class Unreadable(Exception):
    """Rerun cannot read a file; the last line of its message."""


def read_chunks(path: Path) -> list[dict[str, bytes]]:
    """Return the components of the entity of data by name, for each run in a recording; none of another program's.

    Raises:
        Unreadable: the file is damaged, or of a version of Rerun that this one does not read.
    """
    # Without -P the folder of this file comes before the library.
    command = [sys.executable, "-P", __file__, str(path)]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=PATIENCE, check=False)
    except subprocess.TimeoutExpired as error:
        raise Unreadable(f"not read after {PATIENCE} s") from error
    if done.returncode != 0:
        messages = done.stderr.decode(errors="replace").splitlines()
        raise Unreadable(messages[-1] if messages else f"the reader ended with status {done.returncode}")
    return list(pickle.loads(done.stdout))


def _read(path: str) -> list[dict[str, bytes]]:
    # What rerun.chunk.RrdReader reads with; to import rerun takes longer than to read a recording.
    from rerun_bindings import RrdReaderInternal

    # pyarrow would import it, which takes as long as the rest.
    sys.modules["pandas"] = None  # type: ignore[assignment]

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        reader = RrdReaderInternal(path)
        chunks = reader.stream() if any(entry.kind == "recording" for entry in reader.store_entries()) else ()
        # All chunks are gone through, so that a damaged one is noticed.
        data = [chunk.to_record_batch() for chunk in chunks if chunk.entity_path == DATA and chunk.is_static]
    blobs: list[dict[str, bytes]] = []
    for batch in data:
        columns = {name: batch.column(name)[0].values for name in batch.schema.names if "RowId" not in name}
        blobs.append(
            {
                name: str(values[0]).encode() if str(values.type) == "string" else values.to_numpy().tobytes()
                for name, values in columns.items()
            }
        )
    return blobs


if __name__ == "__main__":
    sys.stdout.buffer.write(pickle.dumps(_read(sys.argv[1]), protocol=5))
