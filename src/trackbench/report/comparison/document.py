"""A comparison as a document and as files: trackers over scenarios, or differences with what became of limits."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from trackbench.compare import Comparison
from trackbench.document import Block, Document, Item, Items, Section, named_apart
from trackbench.document.files import ENDINGS as DOCUMENT_ENDINGS
from trackbench.document.files import files, files_by_ending
from trackbench.document.palette import Styles, tracker_styles
from trackbench.report.comparison import differences, ranking
from trackbench.report.comparison.sentences import NAMES
from trackbench.results import json_text


def comparison_document(
    comparison: Comparison,
    *,
    reports: Mapping[str, str] | None = None,
    times: bool = False,
) -> Document:
    """What a comparison says.

    Args:
        comparison: what was found.
        reports: path of the report of each result, relative to the document, by the result's label.
        times: whether times of computing are in it, which are others on each machine.
    """
    styles = tracker_styles(comparison.places or comparison.trackers)
    parts = [_group_text(group, styles, reports or {}, times=times) for group in comparison.groups]
    (title, blocks), lead = parts[0], ""
    if len(parts) > 1:
        title = f"Comparison over {sum(len(group.scenarios) for group in comparison.groups)} scenarios"
        lead = (
            "Scenarios that different metrics rank are compared apart: their trackers do not answer the same question."
        )
        blocks = tuple(map(_section, comparison.groups, parts))
    return Document(
        kind="comparison",
        title=title,
        lead=lead,
        blocks=(*blocks, *_notes(comparison)),
        trackers=tuple(styles.values()),
    )


#: Of scenarios that the same metric ranks: title and blocks.
_GroupText = tuple[str, tuple[Block, ...]]


def _group_text(comparison: Comparison, styles: Styles, reports: Mapping[str, str], *, times: bool) -> _GroupText:
    if len(comparison.sets) == 1 and len(comparison.scenarios) > 1:
        blocks = ranking.ranking_blocks(comparison, styles, reports, times=times)
        return "Comparison of trackers", (*blocks, *differences.reproduction(comparison))
    return f"Comparison{_over(comparison)}", tuple(differences.difference_blocks(comparison, styles, reports))


def _over(comparison: Comparison) -> str:
    names = [scenario.name for scenario in comparison.scenarios]
    return f": {names[0]}" if len(names) == 1 else f" over {len(names)} scenarios"


def _section(comparison: Comparison, part: _GroupText) -> Section:
    """One part of several; its tables and figures are named after what ranks."""
    title = f"By {NAMES[comparison.ranked_by]}{_over(comparison)}"
    return Section(title, named_apart(part[1], comparison.ranked_by))


def _notes(comparison: Comparison) -> Iterator[Block]:
    """What a reader must know beside the numbers, and what could not be compared."""
    notes = [*scenarios_without_truth(comparison), *(note for group in comparison.groups for note in group.notes)]
    missing = dict.fromkeys((item.metric, item.reason) for group in comparison.groups for item in group.not_compared)
    items = [Item(note) for note in notes]
    items += [Item(reason, label=f"{metric} not compared", tone="warn") for metric, reason in missing]
    if items:
        yield Section("Notes", (Items(tuple(items)),))


def scenarios_without_truth(comparison: Comparison) -> Iterator[str]:
    """Which scenarios are not compared for want of a truth."""
    if comparison.without_truth:
        yield f"{', '.join(comparison.without_truth)} not compared: no truth"


ENDINGS = (*DOCUMENT_ENDINGS, ".json")


def batch_files(comparison: Comparison, folder: Path) -> Iterator[tuple[Path, bytes]]:
    """A page, the same as Markdown with its figures, and the data.

    The Markdown and the data have neither times nor links, so they are the same on every machine and can be kept.
    """
    yield from comparison_files(comparison, folder / "comparison.html")
    yield from comparison_files(comparison, folder / "comparison.json")
    for name, content in files(comparison_document(comparison), "markdown", "comparison"):
        yield folder / name, content()


def comparison_files(comparison: Comparison, path: Path) -> Iterator[tuple[Path, bytes]]:
    """The file of a comparison in the format of its ending, and what belongs to it."""
    if path.suffix == ".json":
        yield path, json_text(comparison.json()).encode()
    elif path.suffix == ".html":
        page = comparison_document(comparison, reports=_reports(comparison, path.parent), times=True)
        yield from files_by_ending(page, path)
    else:
        yield from files_by_ending(comparison_document(comparison), path)


def _reports(comparison: Comparison, folder: Path) -> dict[str, str]:
    """Where each result's report is, relative to a folder; those that have none are left out."""
    scenarios = [scenario for group in comparison.groups for scenario in group.scenarios]
    pages = {}
    for label in {result.label for scenario in scenarios for result in scenario.results}:
        page = (Path(label).parent if label.endswith(".json") else Path(label)) / "report.html"
        if page.is_file():
            pages[label] = Path(os.path.relpath(page, folder)).as_posix()
    return pages
