"""The chunks of a recording, read by a process of its own: Rerun's reader ends its process over some damaged files.

The process runs this file by its path, and the file imports nothing of trackbench: it starts in a third of the time.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
import warnings
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa

#: For how long a recording may be read, s.
PATIENCE = 300


class EntityRows(NamedTuple):
    """A chunk: rows of one entity."""

    entity: str
    static: bool
    rows: pa.RecordBatch


class Unreadable(Exception):
    """Rerun cannot read a file; the last line of what it said."""


def read_chunks(path: Path) -> list[EntityRows]:
    """All chunks of a recording; none where the file holds only a layout.

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
        said = done.stderr.decode(errors="replace").splitlines()
        raise Unreadable(said[-1] if said else f"the reader ended with status {done.returncode}")
    return [EntityRows(*chunk) for chunk in pickle.loads(done.stdout)]


def _read(path: str) -> list[tuple[str, bool, pa.RecordBatch]]:
    import rerun as rr
    from rerun.chunk import RrdReader

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rr.error_utils.RerunWarning)
        reader = RrdReader(path)
        chunks = reader.stream() if reader.recordings() else ()
        return [(chunk.entity_path, chunk.is_static, chunk.to_record_batch()) for chunk in chunks]


if __name__ == "__main__":
    sys.stdout.buffer.write(pickle.dumps(_read(sys.argv[1]), protocol=5))
