"""The page of a suite: who is better than whom in each world and scenario, and how the suite is cited."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import yaml

from trackbench.base.errors import InputError, counted
from trackbench.compare import Comparison
from trackbench.document import Block, Cell, Code, Column, Document, Item, Items, Paragraph, Section, Table
from trackbench.document.palette import tracker_styles
from trackbench.report.numbers import decimals, reach_text, short
from trackbench.report.pairs import group_letter, groups_of
from trackbench.results import MetricValue, Result, TrackerResult
from trackbench.scenario.worlds import WORLDS
from trackbench.subjects.suite.entry import ENTRY, StoredEntry
from trackbench.subjects.suite.merge import MergedEntries
from trackbench.subjects.suite.suite import Suite

#: Files beside the page.
RECORDING, REPORT = "recording.rrd", "report.html"
MEANING = (
    "Trackers that share a letter are not shown to differ by more than the margin, and a is the best. ± is half of the "
    "95 % interval over the scenes. A name opens the entry, and the number its recording or its report."
)


def suite_document(merged: MergedEntries, folder: Path) -> Document:
    """Return the page of entries, whose links are relative to a folder."""
    suite = merged.suite.stated
    names = [stored.entry.name for stored in merged.entries]
    styles = tracker_styles({name: number for number, name in enumerate(names)})
    by_world: dict[str, list[Block]] = {world: [] for world in WORLDS}
    for name, result in merged.results.items():
        world = merged.suite.scenarios[name].stated.world or "as stated"
        by_world.setdefault(world, []).append(_scenario_section(merged, name, result, folder))
    blocks: list[Block] = [Paragraph(MEANING)]
    blocks += [Section(f"World: {world}", tuple(sections)) for world, sections in by_world.items() if sections]
    blocks.append(Section("Entries", (_entries(merged, folder),)))
    blocks.append(Section("Cite the suite", (Code(bibtex(merged.suite), "bibtex"),)))
    lead = f"{suite.id}, version {suite.version}: {counted(len(names), 'entry').replace('entrys', 'entries')}"
    return Document("suite", suite.title, tuple(blocks), lead=lead, trackers=tuple(styles.values()))


def _scenario_section(merged: MergedEntries, name: str, result: Result, folder: Path) -> Section:
    """Return the groups of verdicts of one scenario."""
    metrics = getattr(merged.suite.stated.metrics, merged.kind_of(name))
    letters, places = _letters(merged, name, result), {}
    for path in metrics:
        places[path] = decimals([_value(tracker, path) for tracker in result.summary.trackers])
    stored = {item.entry.name: item for item in merged.entries}
    rows = []
    for tracker in result.summary.ranking:
        own = result[tracker]
        cells = [_number(own, path, places[path]) for path in metrics]
        shown = _shown(stored[tracker], name, folder)
        cells[0] = Cell(cells[0].text, cells[0].details, reason=result.why_unscored(own), link=shown)
        entry = os.path.relpath(stored[tracker].folder / ENTRY, folder)
        rows.append((Cell(letters.get(tracker, "")), Cell(tracker, own.marks, tracker=tracker, link=entry), *cells))
    units = [_heading(path, result) for path in metrics]
    columns = (Column("group"), Column("tracker", left=True), *(Column(unit) for unit in units))
    blocks: list[Block] = [Table(name, columns, tuple(rows))]
    published = merged.suite.scenarios[name].stated.published
    if published:
        printed = (Item(f"{item.metric} {item.value:g} ({item.source})", label=item.tracker) for item in published)
        blocks.append(Section("Printed by others", (Items(tuple(printed)),)))
    commands = (f"{item.command}" for stored in merged.entries for item in stored.entry.scenarios if item.id == name)
    blocks.append(Section("Commands", (Code("\n".join(commands), "sh"),), folded=True))
    return Section(f"{name}: {merged.suite.scenarios[name].plain.config.description}", tuple(blocks))


def _letters(merged: MergedEntries, name: str, result: Result) -> dict[str, str]:
    """Return the groups of a scenario by tracker; none where nothing was compared."""
    scored = [tracker for tracker in result.summary.ranking if not result.why_unscored(result[tracker])]
    if len(scored) < 2:
        return {}
    differ = _shown_pairs(merged.comparison, name, result.summary.headline)
    groups = groups_of(scored, lambda a, b: frozenset((a, b)) in differ)
    return {
        tracker: "".join(group_letter(number) for number, group in enumerate(groups) if tracker in group)
        for tracker in scored
    }


def _shown_pairs(comparison: Comparison, scenario: str, metric: str) -> set[frozenset[str]]:
    """Return the pairs of trackers of which one is shown to be better by more than the margin."""
    return {
        frozenset((item.entrant.tracker, item.against.tracker))
        for group in comparison.groups
        for item in group.differences
        if (item.scenario, item.metric) == (scenario, metric) and item.verdict in ("better", "worse")
    }


def _value(tracker: TrackerResult, path: str) -> float | None:
    metric = tracker.metrics.get(path)
    return None if metric is None else metric.value


def _number(tracker: TrackerResult, path: str, places: int) -> Cell:
    metric = tracker.metrics.get(path)
    if metric is None or metric.value is None:
        return Cell("n/a", reason="" if metric is None else metric.reason or "")
    text = number_with_reach(metric, places)
    return Cell(text if metric.verdict is None else f"{text} {metric.verdict}")


def number_with_reach(metric: MetricValue, places: int) -> str:
    """Return a value with its interval: "0.41 ±0.02", or "0.41 (0.36 to 0.52)"."""
    reach = reach_text(metric.value, metric.ci95, places)
    return f"{short(metric.value, places)} {f'({reach})' if ' to ' in reach else reach}".strip()


def _heading(path: str, result: Result) -> str:
    unit = next((each.metrics[path].unit for each in result.summary.trackers if path in each.metrics), "1")
    words = path.replace("_", " ").replace("rmse", "RMSE").replace("gospa", "GOSPA").replace("tGOSPA", "T-GOSPA")
    return words if unit in ("1", "") else f"{words}, {unit}"


def _shown(stored: StoredEntry, scenario: str, folder: Path) -> str:
    """Return the link to the recording of a scenario of an entry, else to its report; empty without either."""
    files = (stored.folder / scenario / name for name in (RECORDING, REPORT))
    return next((os.path.relpath(file, folder) for file in files if file.is_file()), "")


def _entries(merged: MergedEntries, folder: Path) -> Table:
    """Return who the trackers are, and what runs and checks each."""
    rows = []
    for stored in merged.entries:
        entry, place = stored.entry, os.path.relpath(stored.folder, folder)
        identity = entry.tracker
        details = [entry.command, f"trackbench suite verify {place}"]
        name = Cell(identity.name, tuple(details), tracker=identity.name, link=f"{place}/{ENTRY}")
        words = [identity.version, identity.licence, identity.source, identity.made, f"{entry.made_at:%Y-%m-%d}"]
        rows.append((name, *(Cell(word or "not stated") for word in words)))
    headings = ("tracker", "version", "licence", "source", "made", "date")
    return Table("entries", tuple(Column(each, left=True, details="commands") for each in headings), tuple(rows))


def bibtex(suite: Suite) -> str:
    """Return the suite as an entry of BibTeX."""
    stated = suite.stated
    fields: Mapping[str, str] = {
        "title": f"{{{stated.title}}}",
        "author": " and ".join(f"{{{name}}}" for name in stated.authors),
        "year": stated.released[:4],
        "version": str(stated.version),
        "note": f"{stated.id}, sha256 {suite.sha256}",
    }
    lines = [f"  {key} = {{{value}}}," for key, value in fields.items()]
    return "\n".join([f"@misc{{{stated.id},", *lines, "}"]) + "\n"


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
