"""The call ``trackbench.export``, and the formats of scans and truth."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pyarrow as pa

from trackbench.api.scenario import Named, loaded_scenario
from trackbench.base.errors import InputError, nearest_choices
from trackbench.base.types import Progress, no_progress
from trackbench.results import json_text, require_replaceable, require_writable, write_file
from trackbench.results.folder import save_files
from trackbench.scenario import Scenario
from trackbench.scenario.truth import truths_of
from trackbench.subjects.export.manifest import MANIFEST, scan_manifest, truth_manifest
from trackbench.subjects.export.mcap import mcap_scan_files
from trackbench.subjects.export.scans import ScanSource, scan_table, truth_table

#: Function that writes each file of a folder, by file name.
Files = dict[str, Callable[[Path], object]]


def _scan_tables(source: ScanSource) -> Iterable[pa.Table]:
    sensors = source.loaded.config.sensors
    return (scan_table(run, sensors, source.hidden) for run in map(source.scans, source.keys))


def _truth_tables(source: ScanSource) -> Iterable[pa.Table]:
    return (truth_table(scene, item.truth) for scene, item in enumerate(source.truths))


def _write_csv(tables: Iterable[pa.Table], path: Path) -> None:
    """Write numbers with the fewest digits that reproduce them exactly, and nothing for a missing number."""
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


TABLES = {"csv": _write_csv, "parquet": _write_parquet}
FORMATS = (*TABLES, "mcap")


def _scan_files(source: ScanSource, form: str) -> Files:
    """Return the functions that write the scans, by file name; each run is simulated when its file is written."""
    if form == "mcap":
        return mcap_scan_files(source)
    return {f"scans.{form}": lambda path: TABLES[form](_scan_tables(source), path)}


def _truth_files(source: ScanSource, form: str) -> Files:
    ending = form if form in TABLES else "parquet"
    return {f"truth.{ending}": lambda path: TABLES[ending](_truth_tables(source), path)}


def export(
    scenario: Scenario | Named,
    scans: Path | str,
    truth: Path | str | None = None,
    *,
    format: str = "csv",
    progress: Progress = no_progress,
) -> None:
    """Write the scans of every run of a scenario, and its ground truth into another folder.

    The scans are bit for bit those that the scenario's trackers get. Each folder has a ``manifest.json`` and is
    written whole or not at all; the folder of an earlier export is replaced.

    Args:
        scenario: scenario, loaded or by its path or name.
        scans: folder of the scans.
        truth: folder of the truth; None writes no truth.
        format: ``csv``, ``parquet`` or ``mcap``, with which the truth is written as Parquet.
        progress: called with the number of simulated steps and of all steps.

    Raises:
        InputError: the scenario is invalid, or a folder cannot be written or has other contents.
        TrackbenchError: the writing of a folder fails.
    """
    if format not in FORMATS:
        raise InputError(f"there is no format {format!r}; {nearest_choices(format, FORMATS)}", key="format")
    folders = [Path(folder) for folder in (scans, truth) if folder is not None]
    _require_apart(folders)
    for folder in folders:
        require_replaceable(folder, MANIFEST)
        require_writable(folder.parent)
    loaded = loaded_scenario(scenario)
    source = ScanSource(loaded, truths_of(loaded, progress))
    if truth is not None and not source.work.has_truth:
        raise InputError("this recording has no truth to write", key="--truth", file=loaded.path)
    save_files({**_scan_files(source, format), MANIFEST: _writer(scan_manifest, source)}, Path(scans), MANIFEST)
    if truth is not None:
        save_files({**_truth_files(source, format), MANIFEST: _writer(truth_manifest, source)}, Path(truth), MANIFEST)


def _writer(manifest: Callable[[ScanSource], dict[str, Any]], source: ScanSource) -> Callable[[Path], object]:
    """Return the function that writes a manifest; call it after the scans, whose fingerprints the manifest has."""
    return lambda path: write_file(json_text(manifest(source)), path)


def _require_apart(folders: list[Path]) -> None:
    """Refuse nested folders, since a program that reads the scans must not find the truth."""
    resolved = [folder.resolve() for folder in folders]
    if len(resolved) == 2 and (resolved[0].is_relative_to(resolved[1]) or resolved[1].is_relative_to(resolved[0])):
        raise InputError("the truth goes into a folder of its own, apart from the scans", key="--truth")
