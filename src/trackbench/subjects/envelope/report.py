"""The page of an envelope, and what the terminal shows of it."""

from __future__ import annotations

import math
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
from trackbench.metrics.intervals import ALL_THE_SAME
from trackbench.report.numbers import joined_names
from trackbench.subjects.envelope.claim import Claim, ClaimCell, Envelope, State, read_envelope
from trackbench.subjects.envelope.counter_page import counter_sections, nearest_section
from trackbench.subjects.envelope.margins import AxisMargin, holding, margins, place_of_line, undecided

TONES: dict[State, Tone] = {"holds": "good", "fails": "bad", "undecided": "warn"}


def margins_table(claim: Claim) -> Table:
    """For each axis and tracker, where the requirement holds along the line through the scenario."""
    by_tracker = {tracker: margins(claim, tracker) for tracker in claim.trackers}
    lines = by_tracker[claim.trackers[0]]
    columns = [(Column("along", left=True), [Cell(line.axis.name, details=_at(line)) for line in lines])]
    for tracker, held in by_tracker.items():
        cells = [
            Cell(holding(margin), details=tuple(filter(None, [undecided(margin), *_missing(margin)])))
            for margin in held
        ]
        columns.append((Column(f"{tracker} holds", left=True), cells))
    through = all(line.through_base for line in lines)
    own = ", ".join(
        f"{axis.name} {'not stated' if base is None else axis.shown(base)}"
        for axis, base in zip(claim.axes, claim.base, strict=True)
    )
    caption = f"Along lines of cells {'through' if through else 'near'} the scenario itself ({own})"
    return Table.of_columns("margins", columns, caption)


def _missing(margin: AxisMargin) -> list[str]:
    """For each reason, at which values of the axis there is no cell: "none (recorded at 10 Hz) at 20 Hz"."""
    why = margin.absent
    values = {
        text: joined_names([f"{float(v):.4g}" for v in why if why[v] == text]) for text in dict.fromkeys(why.values())
    }
    return [f"{text} at {there} {margin.axis.unit}".strip() for text, there in values.items()]


def _at(margin: AxisMargin) -> tuple[str, ...]:
    """Where the line goes."""
    assumed = _assumed([cell for _, cell in margin.cells])
    rests_on = [f"rests on figures assumed for {assumed}"] if assumed else []
    return (*([f"at {place_of_line(margin)}"] if margin.at else []), *rests_on)


def _assumed(cells: Sequence[ClaimCell]) -> str:
    """The effects of sensors on whose assumed figures some cells rest; empty where on none."""
    return joined_names(list(dict.fromkeys(name for cell in cells for name in cell.assumed)))


def cells_table(claim: Claim) -> Table:
    """Return the table of the cells with their states and values."""
    columns = [
        (Column(axis.name, left=True), [Cell(axis.shown(cell.point[number])) for cell in claim.cells])
        for number, axis in enumerate(claim.axes)
    ]
    columns += [
        (Column(name, left=True), [_state(claim, cell, name) for cell in claim.cells]) for name in claim.trackers
    ]
    return Table.of_columns("cells", columns)


def _state(claim: Claim, cell: ClaimCell, tracker: str) -> Cell:
    """The state with what it rests on."""
    own = cell.trackers[tracker]
    details = [
        f"{limit.metric} {_number(value.value)} ({_number(value.low)} to {_number(value.high)})"
        for limit, value in zip(claim.limits_of(tracker), own.values, strict=False)
        if value.value is not None
    ]
    details += [own.cause] if own.cause else []
    return Cell(own.state, details=(*details, f"{own.scenes} x {own.runs} runs"), tone=TONES[own.state])


def _number(value: float | None) -> str:
    return "open" if value is None else f"{value:.3g}"


#: Figures of further pairs of axes; a page with more is too long to be read.
_MOST_PAIRS = 6


def headlines(claim: Claim) -> Iterator[str]:
    """For each tracker, in how many cells it meets its requirement, and which share is undecided."""
    for tracker in claim.trackers:
        counts, total = claim.counts(tracker), len(claim.cells)
        share = f"{100 * counts['undecided'] / total:.0f} % undecided"
        states = [cell.trackers[tracker] for cell in claim.cells]
        if same := sum(item.state == "undecided" and ALL_THE_SAME in item.cause for item in states):
            share += f", of which {counted(same, 'cell')} because every run is the same"
        yield (
            f"{tracker}: {claim.required_of(tracker)} holds in {counts['holds']} of {counted(total, 'cell')}, "
            f"fails in {counts['fails']}, {share}"
        )
        if failure := claim.failures[tracker]:
            yield f"{tracker}: could not go on: {failure}"


def claim_sentence(claim: Claim) -> str:
    """What is claimed, of which population, how surely, and what it rests on."""
    scenes, runs = claim.extents[-1]
    trackers = "" if len(claim.trackers) == 1 else " for any tracker"
    these = claim.claim == "these scenes"
    many = f"{counted(scenes, 'scene')}, up to {counted(runs, 'run')} of each"
    if not these:
        many = f"up to {counted(scenes, 'scene')}, {counted(runs, 'run')} of each"
    absent = "".join(
        f" Where {item.shown(claim.axes)}: {item.text}, a cell would be a copy of another." for item in claim.absent
    )
    resting = [cell for cell in claim.cells if cell.assumed]
    assumed = f" {counted(len(resting), 'cell')} of them rest on figures assumed for {_assumed(resting)}."
    assumed = assumed if resting else ""
    return (
        f"With {100 * claim.confidence:g} % confidence none of the {counted(len(claim.cells), 'cell')} is decided "
        f"wrongly{trackers}. It is a claim about {claim.claim} ({many}).{absent}{assumed}{_rests_on(claim)}"
    )


def _rests_on(claim: Claim) -> str:
    """Which share of runs, or scenes, may be of a kind that the cells that were decided first have not seen: minus the
    logarithm of the error that the look spends, over their number. Empty where no cell is decided."""
    decided = [item for cell in claim.cells for item in cell.trackers.values() if item.state != "undecided"]
    looks = min((item.looks for item in decided if item.looks), default=0)
    if not looks:
        return ""
    scenes = claim.claim == "traffic like these"
    word, number = ("scene" if scenes else "run"), claim.extents[looks - 1][0 if scenes else 1]
    totals = [0, *(each * runs for each, runs in claim.extents)]
    share = -math.log(claim.spent * (totals[looks] - totals[looks - 1]) / totals[-1]) / number
    return (
        f" It takes for granted that no kind of {word} is rarer than the {word}s can show: the {counted(number, word)} "
        f"that decided the first cells may lack one that makes up {100 * share:.2g} % of all."
    )


def envelope_document(made: Envelope) -> Document:
    """The whole page."""
    claim = made.claim
    styles = tuple(tracker_styles(claim.places or claim.trackers).values())
    maps, lines = [*_maps(claim, styles)], tuple(_lines(claim, styles))
    # Of one tracker all maps; of several those of the first pair of axes.
    shown = len(maps) if len(styles) == 1 else 1
    first = tuple(figure for figures in maps[:shown] for figure in figures) or lines
    blocks: list[Block] = [*_headline(claim), Row((*first[:1], nearest_section(claim)))]
    blocks += [Row(first[1:])] if first[1:] else []
    margins = (*_margins(claim), *([Row(lines)] if maps and lines else []))
    blocks += [Section("Margins", margins)] if margins else []
    blocks += counter_sections(claim)
    blocks += [Section("Further pairs of axes", tuple(map(Row, maps[shown:])))] if maps[shown:] else []
    blocks += [
        Section("Cells", (cells_table(claim),), folded=True),
        Section("How it was decided", (Items(tuple(_decided(claim))),)),
        Section("Repeat it", (Code(claim.command),)),
    ]
    return Document("envelope", _title(claim), tuple(blocks), trackers=styles)


def envelope_summary(made: Envelope) -> Document:
    """What the terminal shows."""
    claim = made.claim
    blocks = (*_headline(claim), *_margins(claim), *counter_sections(claim))
    return Document("envelope", _title(claim), blocks)


def document_of_claim(file: Path) -> Document:
    """The page of an envelope, from its ``claim.json``.

    Raises:
        InputError: it is damaged, or the values of its runs are not beside it.
    """
    return envelope_document(read_envelope(file))


def _title(claim: Claim) -> str:
    return f"Operating envelope of {claim.scenario}"


def _headline(claim: Claim) -> Iterator[Block]:
    heads = (text.split(": ", 1) for text in headlines(claim))
    yield Items(tuple(Item(text, label, tracker=label) for label, text in heads))
    yield Paragraph(claim_sentence(claim))


def _maps(claim: Claim, styles: Sequence[TrackerStyle]) -> Iterator[tuple[Figure, ...]]:
    """The figures of each pair of axes: all borders where there are several trackers, and the cells of each."""
    from trackbench.subjects.envelope.map_figures import borders_figure, map_figure, pairs_of

    for pair in pairs_of(claim)[:_MOST_PAIRS]:
        joint = (borders_figure(claim, pair, styles),) if len(styles) > 1 else ()
        yield (*joint, *(map_figure(claim, pair, style) for style in styles))


def _lines(claim: Claim, styles: Sequence[TrackerStyle]) -> Iterator[Figure]:
    from trackbench.subjects.envelope.line_figures import line_figures

    return line_figures(claim, styles)


def _margins(claim: Claim) -> Iterator[Block]:
    table = margins_table(claim)
    if table.rows:
        yield table


def _decided(claim: Claim) -> Iterator[Item]:
    looks = ", ".join(f"{scenes} x {runs}" for scenes, runs in claim.extents)
    yield Item(f"{looks} (scenes x runs); a cell that is decided is not looked at again", "looks")
    yield Item(f"{claim.spent:.2g} for one tracker in one cell, over all looks, to one side", "error spent")
    added = sum(cell.added for cell in claim.cells)
    yield Item(f"{len(claim.cells) - added} at the start, {added} added near a border", "cells")
    yield Item(f"{claim.seed}; engine {claim.engine}", "seed")
    yield Item(", ".join(f"{name} {version}" for name, version in claim.versions.items()), "versions")
