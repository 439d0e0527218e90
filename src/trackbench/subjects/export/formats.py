"""The formats in which scans and truths are written, by their names."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa

from trackbench.subjects.export import mcap, osi
from trackbench.subjects.export.source import ScanSource
from trackbench.subjects.export.tables import scan_table, truth_table

#: By the name of a file in the folder, what writes it.
Files = dict[str, Callable[[Path], object]]


class ExportFormat(NamedTuple):
    """A format."""

    scans: Callable[[ScanSource], Files]
    """The files of all scans; each run is made when its file is written."""
    truth: Callable[[ScanSource], Files]


def _scan_tables(source: ScanSource) -> Iterable[pa.Table]:
    sensors = source.loaded.config.sensors
    return (scan_table(of_run, sensors, source.hidden) for of_run in source.runs())


def _truth_tables(source: ScanSource) -> Iterable[pa.Table]:
    return (truth_table(scene, item.truth) for scene, item in enumerate(source.truths))


def _write_csv(tables: Iterable[pa.Table], path: Path) -> None:
    """The shortest digits that give the same number back, nothing where one is missing, no needless quotation marks."""
    from pyarrow import compute, csv

    with path.open("wb") as stream:
        for number, table in enumerate(tables):
            if number == 0:
                stream.write(",".join(table.column_names).encode() + b"\n")
            texts = [column for column in table.columns if pa.types.is_string(column.type)]
            special = any(compute.any(compute.match_substring_regex(text, '[,"\r\n]')).as_py() for text in texts)
            options = csv.WriteOptions(include_header=False, quoting_style="needed" if special else "none")
            csv.write_csv(table, stream, options)


def _write_parquet(tables: Iterable[pa.Table], path: Path) -> None:
    from pyarrow import parquet

    writer = None
    for table in tables:
        writer = writer or parquet.ParquetWriter(path, table.schema)
        writer.write_table(table)
    if writer is not None:
        writer.close()


def _tables_in(ending: str, write: Callable[[Iterable[pa.Table], Path], None]) -> ExportFormat:
    return ExportFormat(
        lambda source: {f"scans.{ending}": lambda path: write(_scan_tables(source), path)},
        lambda source: {f"truth.{ending}": lambda path: write(_truth_tables(source), path)},
    )


FORMATS = {
    "csv": _tables_in("csv", _write_csv),
    "parquet": _tables_in("parquet", _write_parquet),
    "mcap": ExportFormat(mcap.scan_files, mcap.truth_files),
    "osi": ExportFormat(osi.scan_files, osi.truth_files),
}
