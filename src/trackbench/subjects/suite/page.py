"""The page of a suite: who is better than whom in each world and scenario, and how the suite is cited."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import yaml

from trackbench.base.errors import InputError, counted
from trackbench.document import Block, Cell, Code, Column, Document, Paragraph, Section, Table
from trackbench.document.html import to_html
from trackbench.document.markdown import to_markdown
from trackbench.document.palette import tracker_styles
from trackbench.report.pairs import group_letter, groups_of
from trackbench.results import Result, TrackerResult
from trackbench.scenario.worlds import WORLDS
from trackbench.subjects.suite.entry import ENTRY
from trackbench.subjects.suite.merge import MergedEntries
from trackbench.subjects.suite.suite import Suite

#: Files of an entry's scenario of which a page opens the first that is there.
OPENED = ("recording.rrd", "report.html")
MEANING = (
    "Trackers that share a letter are not shown to differ by more than the margin, and a is the best. In "
    "brackets: the 95 % interval over the scenes. A name opens the entry, and the number its recording or its report."
)


def page_files(merged: MergedEntries, folder: Path) -> dict[str, str]:
    """Return the text of each file of a page, by name."""
    document = suite_document(merged, folder)
    pages = {"index.html": to_html(document), "index.md": to_markdown(document)}
    return {**pages, "suite.bib": bibtex(merged.suite), "CITATION.cff": citation(merged.suite)}


def suite_document(merged: MergedEntries, folder: Path) -> Document:
    """Return the page of entries, whose links are relative to a folder."""
    suite = merged.suite.stated
    names = [stored.entry.tracker.name for stored in merged.entries]
    styles = tracker_styles({name: number for number, name in enumerate(names)})
    by_world: dict[str, list[Block]] = {world: [] for world in WORLDS}
    for name, result in merged.results.items():
        world = merged.suite.scenarios[name].stated.world or "as stated"
        by_world.setdefault(world, []).append(_scenario_section(merged, name, result, folder))
    blocks: list[Block] = [Paragraph(MEANING)]
    blocks += [Section(f"World: {world}", tuple(sections)) for world, sections in by_world.items() if sections]
    blocks.append(Section("Entries", (_entries(merged, folder),)))
    blocks.append(Section("Cite the suite", (Code(bibtex(merged.suite), "bibtex"),)))
    lead = f"{suite.id}, version {suite.version}: {counted(len(names), 'entry', 'entries')}"
    return Document("suite", suite.title, tuple(blocks), lead=lead, trackers=tuple(styles.values()))


def _scenario_section(merged: MergedEntries, name: str, result: Result, folder: Path) -> Section:
    """Return the groups of verdicts of one scenario."""
    metrics = merged.suite.stated.metrics[merged.suite.scenarios[name].kind]
    letters, stored = _letters(merged, name, result), {item.entry.tracker.name: item for item in merged.entries}
    rows = []
    for tracker in result.summary.ranking:
        own, place = result[tracker], stored[tracker].folder
        first, *others = (_number(own, path) for path in metrics)
        first = replace(first, reason=result.why_unscored(own), link=_shown(place / name, folder))
        entry = Cell(tracker, own.marks, tracker=tracker, link=os.path.relpath(place / ENTRY, folder))
        rows.append((Cell(letters.get(tracker, "")), entry, first, *others))
    headings = (path.upper() if path.isalpha() else path.replace("_", " ").replace("rmse", "RMSE") for path in metrics)
    columns = (Column("group"), Column("tracker", left=True), *map(Column, headings))
    blocks: list[Block] = [Table(name, columns, tuple(rows))]
    commands = (item.command for stored in merged.entries for item in stored.entry.scenarios if item.id == name)
    blocks.append(Section("Commands", (Code("\n".join(commands), "sh"),), folded=True))
    return Section(f"{name}: {merged.suite.scenarios[name].plain.config.description}", tuple(blocks))


def _letters(merged: MergedEntries, name: str, result: Result) -> dict[str, str]:
    """Return the groups of a scenario by tracker; none where nothing was compared."""
    scored = [tracker for tracker in result.summary.ranking if not result.why_unscored(result[tracker])]
    if len(scored) < 2:
        return {}
    differ = {
        frozenset((item.entrant.tracker, item.against.tracker))
        for group in merged.comparison.groups
        for item in group.differences
        if (item.scenario, item.metric) == (name, result.summary.headline) and item.verdict in ("better", "worse")
    }
    groups = groups_of(scored, lambda a, b: frozenset((a, b)) in differ)
    return {
        tracker: "".join(group_letter(number) for number, group in enumerate(groups) if tracker in group)
        for tracker in scored
    }


def _number(tracker: TrackerResult, path: str) -> Cell:
    metric = tracker.metrics.get(path)
    if metric is None or metric.value is None:
        return Cell("n/a", reason="" if metric is None else metric.reason or "")
    return Cell(str(metric) if metric.verdict is None else f"{metric} {metric.verdict}")


def _shown(scenario: Path, folder: Path) -> str:
    """Return the link to the recording of an entry's scenario, else to its report; empty without either."""
    return next((os.path.relpath(scenario / name, folder) for name in OPENED if (scenario / name).is_file()), "")


def _entries(merged: MergedEntries, folder: Path) -> Table:
    """Return who the trackers are, and what runs and checks each."""
    rows = []
    for stored in merged.entries:
        entry, identity, place = stored.entry, stored.entry.tracker, os.path.relpath(stored.folder, folder)
        details = (entry.command, f"trackbench suite verify {place}")
        name = Cell(identity.name, details, tracker=identity.name, link=f"{place}/{ENTRY}")
        words = [identity.version, identity.licence, identity.source, identity.made, f"{entry.made_at:%Y-%m-%d}"]
        rows.append((name, *(Cell(word or "not stated") for word in words)))
    headings = ("tracker", "version", "licence", "source", "made", "date")
    return Table("entries", tuple(Column(each, left=True, details="commands") for each in headings), tuple(rows))


def bibtex(suite: Suite) -> str:
    """Return the suite as an entry of BibTeX."""
    stated = suite.stated
    return f"""\
@misc{{{stated.id},
  title = {{{{{stated.title}}}}},
  author = {{{" and ".join(f"{{{name}}}" for name in stated.authors)}}},
  year = {{{stated.released[:4]}}},
  version = {{{stated.version}}},
  note = {{{stated.id}, sha256 {suite.sha256}}},
}}
"""


def citation(suite: Suite) -> str:
    """Return the suite as a CITATION.cff."""
    stated = suite.stated
    values = {
        "cff-version": "1.2.0",
        "message": "If you use this suite, please cite it as below.",
        "type": "dataset",
        "title": f"{stated.id}: {stated.title}",
        "authors": [{"name": name} for name in stated.authors],
        "version": str(stated.version),
        "date-released": stated.released,
        "license": stated.licence,
        "identifiers": [{"type": "other", "value": f"sha256:{suite.sha256}", "description": "of the suite's file"}],
    }
    return yaml.safe_dump(values, sort_keys=False, width=120)


def entries_in(folder: Path) -> Iterator[Path]:
    """Yield the folder of each entry in a folder.

    Raises:
        InputError: there is none.
    """
    found = sorted(file.parent for file in folder.glob(f"[!.]*/{ENTRY}"))
    if not found:
        hint = "name the folder that holds it" if (folder / ENTRY).is_file() else "`trackbench suite run` writes one"
        raise InputError(f"there is no entry in this folder; {hint}", file=folder)
    yield from found
