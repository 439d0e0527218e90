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
from trackbench.report.pairs import group_letters
from trackbench.report.tables import TRACKER, metric_cells, metric_in_words, metric_of, name_cells, unit_after_heading
from trackbench.scenario.worlds import WORLDS
from trackbench.subjects.suite.entry import ENTRY
from trackbench.subjects.suite.merge import MergedEntries
from trackbench.subjects.suite.suite import Suite

#: Files of an entry's scenario of which a page opens the first that is there.
OPENED = ("recording.rrd", "report.html")
MEANING = (
    "Below, trackers that share a letter are the same, or not shown to be better by more than the margin. A scenario "
    "is judged at 5 % over all pairs of the trackers entered here (Holm), so that more entries may join groups. A name "
    "opens the entry, and the first number its recording or its report. Small print: 95 % intervals, and how large a "
    "covariance is. Whether an entry holds is checked by its command `trackbench suite verify`, not by this page."
)


def page_files(merged: MergedEntries, folder: Path) -> dict[str, str]:
    """Return the text of each file of a suite's page (HTML, Markdown and citations), by file name."""
    document = suite_document(merged, folder)
    pages = {"index.html": to_html(document), "index.md": to_markdown(document)}
    return {**pages, "suite.bib": bibtex(merged.suite), "CITATION.cff": citation(merged.suite)}


def suite_document(merged: MergedEntries, folder: Path) -> Document:
    """Return the page that ranks the trackers entered in a suite; its links are relative to ``folder``."""
    suite = merged.suite.stated
    styles = tracker_styles({stored.entry.tracker.name: number for number, stored in enumerate(merged.entries)})
    blocks: list[Block] = [overview_table(merged), Paragraph(MEANING)]
    for world in (*WORLDS, None):
        names = [name for name in merged.results if merged.suite.scenarios[name].stated.world == world]
        sections = tuple(_scenario_section(merged, name, folder) for name in names)
        blocks += [Section(f"World: {world or 'as stated'}", sections)] if sections else []
    cited = Section("Cite the suite", (Code(bibtex(merged.suite), "bibtex"),))
    blocks += [Section("Entries", (_entries(merged, folder),)), cited]
    lead = f"{suite.id}, version {suite.version}: {counted(len(styles), 'entry', 'entries')}"
    return Document("suite", suite.title, tuple(blocks), lead=lead, trackers=tuple(styles.values()))


def overview_table(merged: MergedEntries) -> Table:
    """Return the table of each scenario's best tracker, and of the trackers that are shown to be worse.

    A scenario with a single tracker is left out.
    """
    rows = []
    for name, result in merged.results.items():
        if len(result.scored) < 2:
            continue
        first, *others = (tracker.name for tracker in result.scored)
        differing = differing_pairs(merged, name)
        worse = [other for other in others if {first, other} in differing]
        alike = [other for other in others if other not in worse]
        score = str(result[first].metrics[result.summary.headline])
        rows.append(tuple(map(Cell, (name, first, score, ", ".join(alike), ", ".join(worse)))))
    headings = ("scenario", "best", "position RMSE or T-GOSPA", "same or not shown", "worse")
    return Table("overview", tuple(Column(each, left=True) for each in headings), tuple(rows))


def _scenario_section(merged: MergedEntries, name: str, folder: Path) -> Section:
    """Return a scenario's section: a table of trackers by rank, with metrics and letters of groups."""
    scenario, result = merged.suite.scenarios[name], merged.results[name]
    places = {stored.entry.tracker.name: stored.folder for stored in merged.entries}
    trackers = [result[tracker] for tracker in result.summary.ranking]
    names = [replace(cell, link=os.path.relpath(places[cell.tracker] / ENTRY, folder)) for cell in name_cells(trackers)]
    letters = scenario_letters(merged, name)
    groups = [Cell(letters.get(each.name, ""), reason=result.why_unscored(each)) for each in trackers]
    columns = [(Column("group"), groups), (TRACKER, names)]
    for path in merged.suite.stated.metrics[scenario.kind]:
        heading = metric_in_words(path) + unit_after_heading(metric_of(trackers[0], path).unit)
        columns.append((Column(heading, details="95 % interval"), metric_cells(trackers, path)))
    shown = zip(columns[2][1], trackers, strict=True)
    columns[2] = columns[2][0], [replace(cell, link=_shown(places[each.name] / name, folder)) for cell, each in shown]
    return Section(f"{name}: {scenario.plain.config.description}", (Table.of_columns(name, columns),))


def scenario_letters(merged: MergedEntries, name: str) -> dict[str, str]:
    """Return the group letters of each tracker in a scenario; empty with a single tracker.

    Trackers that share a letter are not shown to differ.
    """
    scored, differing = [tracker.name for tracker in merged.results[name].scored], differing_pairs(merged, name)
    return group_letters(scored, lambda a, b: {a, b} in differing) if len(scored) > 1 else {}


def differing_pairs(merged: MergedEntries, name: str) -> set[frozenset[str]]:
    """Return the pairs of trackers that are shown to differ in a scenario, by the metric that ranks."""
    headline = merged.results[name].summary.headline
    return {
        frozenset((item.entrant.tracker, item.against.tracker))
        for group in merged.comparison.groups
        for item in group.differences
        if (item.scenario, item.metric) == (name, headline) and item.verdict in ("better", "worse")
    }


def _shown(scenario: Path, folder: Path) -> str:
    """Return the link to the recording of an entry's scenario, else to its report; empty without either."""
    return next((os.path.relpath(scenario / name, folder) for name in OPENED if (scenario / name).is_file()), "")


def _entries(merged: MergedEntries, folder: Path) -> Table:
    """Return the table of entries: who each tracker is, and the commands that run and check it."""
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
    """Return the text of the file ``CITATION.cff`` that cites the suite."""
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
    """Yield the path of each entry (folder with a tracker's estimates and scores) in a folder.

    Raises:
        InputError: there is no entry.
    """
    found = sorted(file.parent for file in folder.glob(f"[!.]*/{ENTRY}"))
    if not found:
        hint = "name the folder that holds it" if (folder / ENTRY).is_file() else "`trackbench suite run` writes one"
        raise InputError(f"there is no entry in this folder; {hint}", file=folder)
    yield from found
