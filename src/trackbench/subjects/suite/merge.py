"""Entries of one suite, made on any machines, as one comparison: their noise is equal, so differences are paired."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from trackbench.base.errors import InputError
from trackbench.compare import Comparison, ResultSet, compare_results
from trackbench.compare.entries import Entry as ComparedEntry
from trackbench.results import Result
from trackbench.results.merged import merged_result
from trackbench.subjects.suite.entry import StoredEntry, read_entry
from trackbench.subjects.suite.suite import Suite


@dataclass(frozen=True)
class MergedEntries:
    """Entries of several trackers in one suite, which are compared with each other."""

    suite: Suite
    entries: Sequence[StoredEntry]

    @cached_property
    def results(self) -> dict[str, Result]:
        """Result of the trackers of all entries, by scenario in the order of the suite.

        Raises:
            InputError: a result is damaged, or was made from other measurements.
        """
        merged = {}
        for name in self.suite.scenarios:
            results = {
                str(stored.folder / name): Result.load(stored.folder / name)
                for stored in self.entries
                for item in stored.entry.scenarios
                if item.id == name
            }
            if results:
                merged[name] = merged_result(results)
        return merged

    @cached_property
    def comparison(self) -> Comparison:
        """Comparison of every pair of trackers in every scenario that several entries have.

        Raises:
            InputError: no scenario is in two entries.
        """
        several = {name: result for name, result in self.results.items() if len(result.summary.trackers) > 1}
        if not several:
            raise InputError("nothing to compare: no scenario is in two entries", file=self.entries[-1].folder)
        entries = tuple(ComparedEntry(name, result) for name, result in several.items())
        kinds = {self.suite.scenarios[name].kind for name in several}
        metrics = [self.suite.stated.metrics[kind][0] for kind in sorted(kinds)]
        compared = compare_results([ResultSet(self.suite.stated.id, entries)], metrics=metrics)
        return compared.model_copy(update={"commands": [stored.entry.command for stored in self.entries]})


def merged_entries(places: Sequence[Path], suite: Path | None = None) -> MergedEntries:
    """Read the entries in several folders and return them together.

    Args:
        places: folders of the entries.
        suite: file of the suite, if it does not come with the package.

    Raises:
        InputError: an entry is damaged or of another suite, or two trackers have the same name.
    """
    entries, folders = [read_entry(place, suite) for place in places], dict[str, Path]()
    first = entries[0]
    for stored in entries:
        for problem in stored.file_problems():
            raise InputError(problem, file=stored.folder)
        if stored.entry.suite != first.entry.suite:
            other = f"is of {_title(stored)}, and {first.folder} of {_title(first)}"
            raise InputError(f"{other}: all entries must be of one suite", file=stored.folder, key="suite")
        name = stored.entry.tracker.name
        if name in folders:
            message = f"{folders[name]} has the same name {name!r}; rename one of them"
            raise InputError(message, file=stored.folder, key="tracker.name")
        folders[name] = stored.folder
    if first.suite.identity != first.entry.suite.model_dump():
        raise InputError(f"is of {_title(first)}, not of the suite here: verify it", file=first.folder, key="suite")
    return MergedEntries(first.suite, entries)


def _title(stored: StoredEntry) -> str:
    suite = stored.entry.suite
    return f"{suite.id} version {suite.version} ({suite.sha256[:8]})"
