"""A comparison as a document: a ranking of trackers over scenarios, or a table of differences for each metric."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from trackbench.base.errors import counted
from trackbench.compare import Comparison, PairDifference
from trackbench.compare.comparison import ComparedResult
from trackbench.document import (
    Block,
    Cell,
    Code,
    Column,
    Document,
    Item,
    Items,
    Paragraph,
    Row,
    Section,
    Table,
    with_name_prefix,
)
from trackbench.document.files import ENDINGS as DOCUMENT_ENDINGS
from trackbench.document.files import files, files_by_ending
from trackbench.document.palette import Styles, tracker_styles
from trackbench.report.comparison import ranking
from trackbench.report.comparison.figures import difference_figure
from trackbench.report.comparison.over_scenarios import TONES, scenario_table
from trackbench.report.comparison.over_time import (
    course_figure,
    first_shown_in_words,
    is_over_time,
    origin_blocks,
)
from trackbench.report.comparison.sentences import (
    NAMES,
    answer_blocks,
    difference_decimals,
    difference_subject,
    differences_from,
    entrant_name,
    in_percent,
    set_letter,
    shown_against,
)
from trackbench.report.numbers import half_width, short
from trackbench.report.pairs import difference_word
from trackbench.report.scenes import parts_in_words, undrawn_scenes
from trackbench.report.tables import unit_after_heading
from trackbench.results import json_text


def comparison_document(comparison: Comparison, reports: Mapping[str, str] | None = None) -> Document:
    """Return the report of a comparison: answer, ranking or differences by metric, notes and commands.

    Args:
        comparison: the comparison.
        reports: path of each result's report, relative to the document, by the result's label; None for no links.
    """
    styles = tracker_styles(comparison.places or comparison.trackers)
    parts = [_group_text(group, styles, reports or {}) for group in comparison.groups]
    (title, blocks), lead = parts[0], ""
    if len(parts) > 1:
        title = f"Comparison over {sum(len(group.scenarios) for group in comparison.groups)} scenarios"
        lead = "Scenarios that are ranked by different metrics are compared apart: they answer different questions."
        blocks = tuple(map(_section, comparison.groups, parts))
    return Document(
        kind="comparison",
        title=title,
        lead=lead,
        blocks=(*blocks, *origin_blocks(comparison), *_notes(comparison)),
        trackers=tuple(styles.values()),
    )


#: Title and blocks of the scenarios that one metric ranks.
_GroupText = tuple[str, tuple[Block, ...]]


def _group_text(comparison: Comparison, styles: Styles, reports: Mapping[str, str]) -> _GroupText:
    if len(comparison.sets) == 1 and len(comparison.scenarios) > 1:
        blocks = ranking.ranking_blocks(comparison, reports)
        return "Comparison of trackers", (*blocks, *reproduction_blocks(comparison))
    return f"Comparison{_over(comparison)}", tuple(difference_blocks(comparison, styles))


def _over(comparison: Comparison) -> str:
    names = [scenario.name for scenario in comparison.scenarios]
    return f": {names[0]}" if len(names) == 1 else f" over {len(names)} scenarios"


def _section(comparison: Comparison, part: _GroupText) -> Section:
    """Return the section on scenarios that one metric ranks, with the metric in the names of tables and figures."""
    title = f"By {NAMES[comparison.ranked_by]}{_over(comparison)}"
    return Section(title, with_name_prefix(part[1], comparison.ranked_by))


def _notes(comparison: Comparison) -> Iterator[Block]:
    """Yield a section with notes and the metrics that could not be compared, if there are any."""
    notes = [*scenarios_without_truth(comparison), *(note for group in comparison.groups for note in group.notes)]
    missing = dict.fromkeys((item.metric, item.reason) for group in comparison.groups for item in group.not_compared)
    items = [Item(note) for note in notes]
    items += [Item(reason, label=f"{metric} not compared", tone="warn") for metric, reason in missing]
    if items:
        yield Section("Notes", (Items(tuple(items)),))


def scenarios_without_truth(comparison: Comparison) -> Iterator[str]:
    """Yield a note that names the scenarios without a truth, which are not compared."""
    if comparison.without_truth:
        yield f"{', '.join(comparison.without_truth)} not compared: no truth"


ENDINGS = (*DOCUMENT_ENDINGS, ".json")


def batch_files(comparison: Comparison, folder: Path) -> Iterator[tuple[Path, bytes]]:
    """Yield paths and contents of the comparison as a page, as Markdown with figures, and as data.

    Markdown and data contain neither times nor links, so that they are equal on every machine.
    """
    yield from comparison_files(comparison, folder / "comparison.html")
    yield from comparison_files(comparison, folder / "comparison.json")
    for name, content in files(comparison_document(comparison), "markdown", "comparison"):
        yield folder / name, content()


def comparison_files(comparison: Comparison, path: Path) -> Iterator[tuple[Path, bytes]]:
    """Yield paths and contents of the files of a comparison, in the format of the path's ending."""
    if path.suffix == ".json":
        yield path, json_text(comparison.json()).encode()
    elif path.suffix == ".html":
        page = comparison_document(comparison, _reports(comparison, path.parent))
        yield from files_by_ending(page, path)
    else:
        yield from files_by_ending(comparison_document(comparison), path)


def _reports(comparison: Comparison, folder: Path) -> dict[str, str]:
    """Return the path of each result's report, if it exists, relative to ``folder``, by the result's label."""
    scenarios = [scenario for group in comparison.groups for scenario in group.scenarios]
    pages = {}
    for label in {result.label for scenario in scenarios for result in scenario.results}:
        page = (Path(label).parent if label.endswith(".json") else Path(label)) / "report.html"
        if page.is_file():
            pages[label] = Path(os.path.relpath(page, folder)).as_posix()
    return pages


def difference_blocks(comparison: Comparison, styles: Styles) -> Iterator[Block]:
    """Yield the blocks of a comparison: limits, answer, differences by metric, and compared results."""
    yield from answer_blocks(comparison)
    for metric, items in comparison.by_metric():
        yield Section(
            f"{metric}{unit_after_heading(items[0].unit)}", tuple(_metric_section(comparison, styles, metric, items))
        )
    yield Section("Results", (_results(comparison),))
    yield from reproduction_blocks(comparison)


def _metric_section(
    comparison: Comparison, styles: Styles, metric: str, items: Sequence[PairDifference]
) -> Iterator[Block]:
    several = len(comparison.scenarios) > 1
    against = shown_against(comparison, items)
    shown = differences_from(against, items) if against else sorted(items, key=lambda item: item.identical)
    if several:
        yield scenario_table(comparison, metric)
    else:
        yield _differences(comparison, metric, shown)
    if is_over_time(comparison):
        if text := first_shown_in_words(comparison, items):
            yield Paragraph(text)
        yield Row((course_figure(comparison, metric, items, styles),))
    elif not all(item.identical for item in shown):
        labels = [
            difference_subject(comparison, item) if against or len(comparison.sets) > 1 else _pair(item)
            for item in shown
        ]
        yield Row((difference_figure(metric, shown, labels, styles, against or ""),))
    if several or len(shown) < len(items):
        title = "Each difference" if several else "Each pair"
        each = _differences(comparison, metric, items)
        yield Section(title, (replace(each, name=f"{each.name}-each"),), folded=True)
    yield Paragraph(_method(items, _tests(comparison)))


def _pair(item: PairDifference) -> str:
    return f"{item.entrant.tracker} against {item.against.tracker}"


def reproduction_blocks(comparison: Comparison) -> Iterator[Block]:
    """Yield the commands that reproduce the compared results, if the commands are known."""
    if comparison.commands:
        yield Section("Reproduce", (Code("\n".join(comparison.commands), "sh"),))


def _pairing(result: ComparedResult) -> str:
    if not result.reason:
        return ""
    return f"{'unpaired' if result.shared_runs is None else 'paired'}: {result.reason}"


def _tests(comparison: Comparison) -> int:
    """Return the number of differences that are tested together.

    In a single set of results all differences are tested. Between sets, differences with the same value in every run
    are not tested.
    """
    return sum(len(comparison.sets) == 1 or not item.identical for item in comparison.differences)


def _method(items: Sequence[PairDifference], tests: int) -> str:
    """Return a sentence on how the differences ``items`` of a metric are judged, ``tests`` of them together."""
    ways = [
        f"paired over {parts}"
        for parts in sorted({_parts(item, item.paired_runs) for item in items if item.paired_runs})
    ]
    ways += ["unpaired (Welch's test)"] * any(item.paired_runs is None for item in items)
    corrected = f" for {tests} differences together (Holm), and ± is the 95 % interval of each alone" * (tests > 1)
    fewest, few_decide = min(item.scenes for item in items), any(item.few_scenes_decide for item in items)
    undrawn = "".join(f" {sentence}." for sentence in undrawn_scenes(fewest, few_decide))
    return f"Differences are {' or '.join(ways)}, judged at 5 %{corrected}; same: within the margin.{undrawn}"


def _parts(item: PairDifference, runs: int) -> str:
    """Return text on the runs, scenes or stretches of time in which two trackers are paired for a difference."""
    parts, stretches = parts_in_words(item.scenes_in_words, runs, item.scenes), item.stretches
    return f"{counted(stretches, 'stretch', 'stretches')} of time of {parts}" if stretches else parts


def _differences(comparison: Comparison, metric: str, items: Sequence[PairDifference]) -> Table:
    digits = difference_decimals(items)

    def with_reach(item: PairDifference) -> str:
        reach = "" if item.ci95 is None else f" ±{short(half_width(item.ci95), digits)}"
        return "0 in every run" if item.identical else short(item.difference, digits) + reach

    entrants = [item.entrant for item in items]
    cells = [Cell(entrant_name(comparison, entrant), tracker=entrant.tracker) for entrant in entrants]
    tracker = (Column("tracker", left=True), cells)
    if len(comparison.scenarios) > 1:
        names = [(Column("scenario", left=True), [Cell(item.scenario) for item in items]), tracker]
    else:
        against = [Cell(entrant_name(comparison, item.against, item.entrant)) for item in items]
        names = [tracker, (Column("against"), against)]
    columns = [
        *names,
        (Column("difference"), [Cell(with_reach(item)) for item in items]),
        (
            Column("verdict", left=True),
            [Cell(difference_word(item.verdict), tone=TONES.get(item.verdict, ""), chip=True) for item in items],
        ),
        (Column("%", "of the value that it is compared with"), [Cell(in_percent(item.percent)) for item in items]),
        (Column("value"), [Cell(short(item.value, digits)) for item in items]),
        (
            Column("margin", "largest difference that does not matter"),
            [Cell(short(item.margin, digits)) for item in items],
        ),
    ]
    return Table.of_columns(f"differences-{metric.replace('.', '-')}", columns)


def _results(comparison: Comparison) -> Items:
    """Return a list of the compared results: runs, seed, and whether paired with the baseline."""
    items = [
        Item(
            f"{result.label}: {counted(result.runs, 'run')}, seed {result.seed}",
            label=set_letter(result.set) if len(comparison.sets) > 1 else "",
            detail=_pairing(result),
        )
        for scenario in comparison.scenarios
        for result in scenario.results
    ]
    return Items(tuple(items))
