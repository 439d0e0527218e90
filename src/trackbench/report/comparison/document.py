"""A comparison as a document: trackers over scenarios with their ranking, or differences with what became of limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from trackbench.compare import Comparison
from trackbench.document import Block, Document, Item, Items, Section
from trackbench.document.styles import tracker_styles
from trackbench.palette import tracker_colours
from trackbench.report.comparison import differences, ranking


def document(
    comparison: Comparison,
    colours: Mapping[str, str] | None = None,
    *,
    reports: Mapping[str, str] | None = None,
    times: bool = False,
) -> Document:
    """What a comparison says.

    Args:
        comparison: what was found.
        colours: of its trackers, by name; in the order in which they first appear unless given.
        reports: path of the report of each result, relative to the document, by the result's label.
        times: whether times of computing are in it, which are others on each machine.
    """
    colours = colours or tracker_colours(comparison.trackers)
    if len(comparison.sets) == 1 and len(comparison.scenarios) > 1:
        blocks = [*ranking.blocks(comparison, colours, reports or {}, times=times)]
        title, lead = "Comparison of trackers", ranking.lead(comparison)
    else:
        blocks = [*differences.blocks(comparison, colours, reports or {})]
        names = [scenario.name for scenario in comparison.scenarios]
        over = f": {names[0]}" if len(names) == 1 else f" over {len(names)} scenarios"
        title, lead = f"Comparison{over}", differences.lead(comparison)
    styles = tracker_styles(colours)
    return Document(
        kind="comparison",
        title=title,
        lead=lead,
        blocks=(*blocks, *_notes(comparison)),
        trackers=tuple(styles.values()),
    )


def _notes(comparison: Comparison) -> Iterator[Block]:
    """What a reader must know beside the numbers, and what could not be compared."""
    found = [Item(note) for note in comparison.notes]
    missing = dict.fromkeys((item.metric, item.reason) for item in comparison.not_compared)
    found += [Item(reason, label=f"{metric} not compared", tone="warn") for metric, reason in missing]
    if found:
        yield Section("Notes", (Items(tuple(found)),))
