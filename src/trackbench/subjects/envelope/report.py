"""The page of an envelope: its headlines and its document."""

from __future__ import annotations

from collections.abc import Iterator

from trackbench.base.errors import counted
from trackbench.document import Block, Cell, Code, Column, Document, Item, Items, Section, Table
from trackbench.subjects.envelope.claim import Claim, Envelope
from trackbench.subjects.envelope.margin_text import along, holding, undecided
from trackbench.subjects.envelope.margins import Margin, margins
from trackbench.subjects.envelope.suites import suite_sentences


def headlines(claim: Claim) -> Iterator[str]:
    """For each tracker, in how many cells it meets its requirement, and which share is undecided."""
    for tracker in claim.trackers:
        counts, total = claim.counts(tracker), len(claim.cells)
        limits = " and ".join(limit.text.removeprefix(f"{tracker} ") for limit in claim.limits_of(tracker))
        share = f"{100 * counts['undecided'] / total:.0f} % undecided"
        yield (
            f"{tracker}: {limits} holds in {counts['holds']} of {counted(total, 'cell')}, "
            f"fails in {counts['fails']}, {share}"
        )


def envelope_document(made: Envelope) -> Document:
    """The whole page."""
    return Document(
        "envelope",
        f"Operating envelope of {made.claim.scenario}",
        (*_summary(made), Section("Repeat it", (Code(made.claim.command),))),
    )


def envelope_summary(made: Envelope) -> Document:
    """What the terminal shows."""
    return Document("envelope", f"Operating envelope of {made.claim.scenario}", tuple(_summary(made)))


def _summary(made: Envelope) -> Iterator[Block]:
    yield Items(tuple(Item(text) for text in headlines(made.claim)))
    yield from _margins(made.claim)
    if sentences := [*suite_sentences(made.claim)]:
        yield Section("Cheapest suites", (Items(tuple(map(Item, sentences))),))
    yield _cells(made.claim)


def _margins(claim: Claim) -> Iterator[Block]:
    found = [margin for tracker in claim.trackers for margin in margins(claim, tracker)]
    if found:
        columns = [
            (Column("tracker", left=True), [Cell(margin.tracker, tracker=margin.tracker) for margin in found]),
            (Column("axis", left=True), [Cell(margin.axis.name) for margin in found]),
            (Column("holds", left=True), [Cell(holding(margin), details=_further(margin)) for margin in found]),
        ]
        yield Section("Margins", (Table.of_columns("margins", columns),))


def _further(margin: Margin) -> tuple[str, ...]:
    """What is undecided, and where the line goes."""
    return tuple(text for text in (undecided(margin), f"at {along(margin)}" if margin.at else "") if text)


def _cells(claim: Claim) -> Table:
    columns = [Column(axis.name, left=True) for axis in claim.axes] + [Column(name) for name in claim.trackers]
    rows = tuple(
        (
            *(Cell(axis.shown(value)) for axis, value in zip(claim.axes, cell.at, strict=True)),
            *(Cell(cell.trackers[name].state) for name in claim.trackers),
        )
        for cell in claim.cells
    )
    return Table("cells", tuple(columns), rows)
