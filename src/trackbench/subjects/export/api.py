"""``trackbench.export``."""

from __future__ import annotations

from pathlib import Path

from trackbench.api.scenario import Named, loaded_scenario
from trackbench.base.errors import InputError, nearest
from trackbench.base.types import Progress, no_progress
from trackbench.results import require_replaceable, require_writable
from trackbench.results.folder import save_files
from trackbench.scenario import Scenario
from trackbench.scenario.truth import truths_of
from trackbench.subjects.export.formats import FORMATS, Files
from trackbench.subjects.export.manifest import MANIFEST, manifest_writer, scan_manifest, truth_manifest
from trackbench.subjects.export.source import ScanSource


def export(
    scenario: Scenario | Named,
    scans: Path | str,
    truth: Path | str | None = None,
    *,
    format: str = "csv",
    progress: Progress = no_progress,
) -> None:
    """Write the scans of every run of a scenario, and its truth into another folder.

    The scans are those that the scenario's trackers get, bit for bit. Each folder has a ``manifest.json`` and is
    written whole or not at all; one of an earlier export is replaced.

    Args:
        scenario: what :func:`load` gave or takes.
        scans: the folder of the scans.
        truth: the folder of the truth; it is not written unless given.
        format: ``csv``, ``parquet``, ``mcap`` or ``osi``.
        progress: called with the number of steps simulated and of all.

    Raises:
        InputError: something is wrong in the scenario, a folder cannot be written or holds something else.
        TrackbenchError: a folder cannot be written to its end.
    """
    if format not in FORMATS:
        raise InputError(f"there is no format {format!r}; {nearest(format, FORMATS)}", key="format")
    folders = [Path(folder) for folder in (scans, truth) if folder is not None]
    _require_apart(folders)
    for folder in folders:
        require_replaceable(folder, MANIFEST)
        require_writable(folder.parent)
    loaded, written = loaded_scenario(scenario), FORMATS[format]
    source = ScanSource(loaded, truths_of(loaded, progress))
    if truth is not None and not source.work.has_truth:
        raise InputError("this recording has no truth to write", key="--truth", file=loaded.path)
    files: Files = written.scans(source) | {MANIFEST: manifest_writer(lambda: scan_manifest(source))}
    save_files(files, Path(scans), MANIFEST)
    if truth is not None:
        files = written.truth(source) | {MANIFEST: manifest_writer(lambda: truth_manifest(source))}
        save_files(files, Path(truth), MANIFEST)


def _require_apart(folders: list[Path]) -> None:
    """A program that reads the scans must not come upon the truth."""
    places = [folder.resolve() for folder in folders]
    if len(places) == 2 and (places[0].is_relative_to(places[1]) or places[1].is_relative_to(places[0])):
        raise InputError("the truth goes into a folder of its own, apart from the scans", key="--truth")
