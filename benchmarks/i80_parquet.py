"""Make the recording of I-80 that comes with the package from a traffic history of SMARTS.

    python -m benchmarks.i80_parquet FILE.shf

Only facts are kept, as integers: time ms, id, position mm, heading 1e-4 rad, speed mm/s, length and width mm.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from trackbench.truth.formats.smarts import Smarts
from trackbench.truth.formats.tables import I80_FACTORS, I80_FILE


def main(source: Path, target: Path = I80_FILE) -> None:
    """Read the history and write the table."""
    tracks = Smarts().read(source)

    def column(key: str, values: np.ndarray) -> pa.Array:
        return pa.array(np.round(values / I80_FACTORS.get(key, 1.0)).astype(np.int32))

    parts: dict[str, list[np.ndarray]] = {}
    for track in tracks:
        rows = np.ones(len(track.time))
        own = {
            "time": track.time,
            "id": int(track.id) * rows,
            "x": track.x,
            "y": track.y,
            "heading": track.heading,
            "speed": track.speed,
            "length": track.length * rows,
            "width": track.width * rows,
        }
        for key, values in own.items():
            parts.setdefault(key, []).append(values)
    table = pa.table({key: column(key, np.concatenate(values)) for key, values in parts.items()})
    pq.write_table(
        table, target, compression="zstd", compression_level=19, use_dictionary=["id", "length", "width", "time"],
        column_encoding=dict.fromkeys(("x", "y", "heading", "speed"), "DELTA_BINARY_PACKED"),
    )  # fmt: skip
    print(f"{target.name}: {len(tracks)} vehicles, {len(table)} rows, {target.stat().st_size} bytes")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
