"""The page of an envelope, and its summary for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from trackbench.base.errors import counted
from trackbench.document import (
    Block,
    Cell,
    Code,
    Column,
    Document,
    Figure,
    Item,
    Items,
    Paragraph,
    Row,
    Section,
    Table,
    Tone,
    TrackerStyle,
)
from trackbench.document.palette import tracker_styles
from trackbench.report.pairs import difference_word
from trackbench.subjects.envelope.claim import Claim, ClaimCell, Envelope, State, read_envelope
from trackbench.subjects.envelope.counter_page import counter_section
from trackbench.subjects.envelope.margins import holding, margins, place_of_line, undecided
from trackbench.subjects.envelope.text_map import map_blocks

TONES: dict[State, Tone] = {"holds": "good", "fails": "bad", "undecided": "warn"}


def margins_tables(claim: Claim) -> Iterator[Table]:
    """Yield the table of margins along the lines nearest to the scenario; nothing without an axis of numbers."""
    by_tracker = {tracker: margins(claim, tracker) for tracker in claim.trackers}
    lines = by_tracker[claim.trackers[0]]
    if not lines:
        return
    places = [(f"at {place_of_line(line)}",) if line.at else () for line in lines]
    names = [Cell(line.axis.name, details=place) for line, place in zip(lines, places, strict=True)]
    columns = [(Column("along", left=True), names)]
    for tracker, held in by_tracker.items():
        cells = [Cell(holding(margin), details=tuple(filter(None, [undecided(margin)]))) for margin in held]
        columns.append((Column(f"{tracker} holds", left=True), cells))
    scenario_values = ", ".join(
        f"{axis.name} {'not stated' if base is None else axis.shown(base)}"
        for axis, base in zip(claim.axes, claim.base, strict=True)
    )
    caption = f"Along the lines of cells that are nearest to the scenario itself ({scenario_values})"
    yield Table.of_columns("margins", columns, caption)


def cells_table(claim: Claim) -> Table:
    """Return the table of all cells with their states and values."""
    columns = [
        (Column(axis.name, left=True), [Cell(axis.shown(cell.point[number])) for cell in claim.cells])
        for number, axis in enumerate(claim.axes)
    ]
    columns += [
        (Column(name, left=True), [_state_cell(claim, cell, name) for cell in claim.cells]) for name in claim.trackers
    ]
    return Table.of_columns("cells", columns)


def _state_cell(claim: Claim, cell: ClaimCell, tracker: str) -> Cell:
    tracker_state = cell.trackers[tracker]
    details = [
        f"{limit.metric} {value.text}"
        for limit, value in zip(claim.limits_of(tracker), tracker_state.values, strict=False)
        if value.value is not None
    ]
    details += [tracker_state.cause] if tracker_state.cause else []
    details.append(f"{tracker_state.scenes} x {tracker_state.runs} runs")
    return Cell(difference_word(tracker_state.state), details=tuple(details), tone=TONES[tracker_state.state])


#: Largest number of pairs of axes that have figures, since a page with more is too long to read.
_MOST_PAIRS = 6


def headlines(claim: Claim) -> Iterator[str]:
    """Yield a sentence per tracker: the cells in which its requirement holds and fails, and the undecided share."""
    for tracker in claim.trackers:
        counts, total = claim.counts(tracker), len(claim.cells)
        share = f"{100 * counts['undecided'] / total:.0f} % not shown"
        yield (
            f"{tracker}: {claim.required_of(tracker)} holds in {counts['holds']} of {counted(total, 'cell')}, "
            f"fails in {counts['fails']}, {share}"
        )
        if failure := claim.failures[tracker]:
            yield f"{tracker}: could not go on: {failure}"


def claim_sentence(claim: Claim) -> str:
    """Return the claim in words: confidence, population (these scenes or traffic like these), scenes and runs."""
    scenes, runs = claim.extents[-1]
    trackers = "" if len(claim.trackers) == 1 else " for any tracker"
    numbers = f"{counted(scenes, 'scene')}, up to {counted(runs, 'run')} of each"
    if claim.claim == "traffic like these":
        numbers = f"up to {counted(scenes, 'scene')}, {counted(runs, 'run')} of each"
    absent = ""
    for item in claim.absent:
        at = ", ".join(f"{axis.name} {axis.shown(item.at[axis.name])}" for axis in claim.axes if axis.name in item.at)
        absent += f" There is no cell with {at} ({item.reason}): it would be a copy of another."
    return (
        f"With {100 * claim.confidence:g} % confidence none of the {counted(len(claim.cells), 'cell')} is decided "
        f"wrongly{trackers}. It is a claim about {claim.claim} ({numbers}).{absent}"
    )


def envelope_document(envelope: Envelope) -> Document:
    """Return the page of an envelope: where trackers meet their requirements, with maps, margins, counter-examples."""
    from trackbench.subjects.envelope.line_figures import line_figures

    claim = envelope.claim
    styles = tuple(tracker_styles(claim.places or claim.trackers).values())
    maps, lines = [*_maps(claim, styles)], tuple(line_figures(claim, styles))
    margins: list[Block] = [*margins_tables(claim), *([Row(lines)] if lines else [])]
    counter = counter_section(claim, envelope.nearest_run)
    blocks: list[Block] = [*_headline(claim), *(Row(row) for row in maps[:1]), *counter]
    blocks += [Section("Margins", tuple(margins))] if margins else []
    blocks += [Section("Further pairs of axes", tuple(map(Row, maps[1:])))] if maps[1:] else []
    blocks += [Section("Cells", (cells_table(claim),), folded=True), Section("Repeat it", (Code(claim.command),))]
    return Document("envelope", f"Operating envelope of {claim.scenario}", tuple(blocks), trackers=styles)


def envelope_summary(envelope: Envelope) -> Document:
    """Return the terminal summary of an envelope: counts of cells, maps, margins and counter-examples."""
    claim = envelope.claim
    maps = [block for tracker in claim.trackers for block in map_blocks(claim, tracker)]
    blocks = (*_headline(claim), *maps, *margins_tables(claim), *counter_section(claim, envelope.nearest_run))
    return Document("envelope", f"Operating envelope of {claim.scenario}", blocks)


def document_of_claim(file: Path) -> Document:
    """Return the page of an envelope, read from its ``claim.json``.

    Raises:
        InputError: the file is damaged, or the values of its runs are not beside it.
    """
    return envelope_document(read_envelope(file))


def _headline(claim: Claim) -> Iterator[Block]:
    texts = (text.split(": ", 1) for text in headlines(claim))
    yield Items(tuple(Item(text, label) for label, text in texts))
    yield Paragraph(claim_sentence(claim))


def _maps(claim: Claim, styles: Sequence[TrackerStyle]) -> Iterator[tuple[Figure, ...]]:
    """Yield the figures of each pair of axes: where requirements cease to hold, together, and each tracker's cells."""
    from trackbench.subjects.envelope.map_figures import borders_figure, map_figure, pairs_of

    for pair in pairs_of(claim)[:_MOST_PAIRS]:
        joint = (borders_figure(claim, pair, styles),) if len(styles) > 1 else ()
        yield (*joint, *(map_figure(claim, pair, style) for style in styles))
