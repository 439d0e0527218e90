"""Results as they are named on the command line: folders of runs, or of many runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from trackbench import results
from trackbench.base.errors import InputError
from trackbench.compare.entries import Entry, ResultSet
from trackbench.results import Result


def results_in(folder: Path, found: Sequence[Result]) -> ResultSet:
    """Results that are at hand, each with a folder of the scenario's name in a folder."""
    return ResultSet(str(folder), tuple(Entry(str(folder / result.name), result) for result in found))


def find(path: Path) -> ResultSet:
    """The result in the folder of a run (or in its ``result.json``), or those in the folders of a folder.

    Raises:
        InputError: there is none, one is no result, or two are of the same scenario.
    """
    folders = [path]
    if path.is_dir() and not (path / results.SUMMARY).is_file():
        folders = sorted(file.parent for file in path.glob(f"[!.]*/{results.SUMMARY}"))
        if (path / results.EXAMINATION).is_file():
            raise InputError("an examination is not compared; `trackbench report` shows it", file=path)
        if not folders:
            raise InputError(f"no {results.SUMMARY} in this folder, nor in the folders in it", file=path)
    entries = tuple(Entry(str(folder), Result.load(folder)) for folder in folders)
    known: dict[str, str] = {}
    for entry in entries:
        name = entry.result.name
        if name in known:
            raise InputError(f"two results of the scenario {name!r}, here and in {known[name]}", file=entry.label)
        known[name] = entry.label
    return ResultSet(str(path), entries)
