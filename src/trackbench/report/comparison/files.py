"""The files of a comparison."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from trackbench.compare import Comparison
from trackbench.document.files import ENDINGS as DOCUMENT_ENDINGS
from trackbench.document.files import files, files_by_ending
from trackbench.report.comparison.document import document
from trackbench.results import to_json

ENDINGS = (*DOCUMENT_ENDINGS, ".json")


def batch_files(comparison: Comparison, folder: Path, colours: Mapping[str, str]) -> Iterator[tuple[Path, bytes]]:
    """A page, the same as Markdown with its figures, and the data; ``colours`` are those of its trackers.

    The Markdown and the data have neither times nor links, so they are the same on every machine and can be kept.
    """
    yield from comparison_files(comparison, folder / "comparison.html", colours)
    yield from comparison_files(comparison, folder / "comparison.json", colours)
    for name, content in files(document(comparison, colours), "markdown", "comparison"):
        yield folder / name, content()


def comparison_files(
    comparison: Comparison, path: Path, colours: Mapping[str, str] | None = None
) -> Iterator[tuple[Path, bytes]]:
    """The file of a comparison in the format of its ending, and what belongs to it."""
    if path.suffix == ".json":
        yield path, to_json(comparison.json()).encode()
    elif path.suffix == ".html":
        page = document(comparison, colours, reports=_reports(comparison, path.parent), times=True)
        yield from files_by_ending(page, path)
    else:
        yield from files_by_ending(document(comparison, colours), path)


def _reports(comparison: Comparison, folder: Path) -> dict[str, str]:
    """Where each result's report is, relative to a folder; those that have none are left out."""
    found = {}
    scenarios = [scenario for group in comparison.groups for scenario in group.scenarios]
    for label in {result.label for scenario in scenarios for result in scenario.results}:
        run = Path(label).parent if label.endswith(".json") else Path(label)
        if (run / "report.html").is_file():
            found[label] = Path(os.path.relpath(run / "report.html", folder)).as_posix()
    return found
