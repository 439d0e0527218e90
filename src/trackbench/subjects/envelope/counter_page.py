"""What a page says of counter-examples."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping

from trackbench.base.errors import counted
from trackbench.document import Block, Cell, Code, Column, Item, Items, Paragraph, Section, Table
from trackbench.subjects.envelope.claim import Claim
from trackbench.subjects.envelope.counter_models import COUNTER_EXAMPLES, CounterExample, CounterExamples

#: How the state of a cell on other seeds is read.
AGAIN = {
    "fails": "fails again",
    "holds": "holds: not repeated",
    "undecided": "undecided: not shown to fail again",
}


_NEXT = "Next, in the folder of this page:"


def counter_sections(claim: Claim, listed: bool = True) -> Iterator[Section]:
    """The nearest counter-examples with their causes, and the runs beyond the limit in cells that hold.

    Args:
        claim: of the map.
        listed: whether these runs are listed.
    """
    counter = claim.counter_examples
    if counter is None:
        return
    notes = [Item(f"{base.tracker}: {base.note}") for base in counter.bases if base.note]
    blocks: list[Block] = [Items(tuple(notes))] if notes else []
    if counter.examples:
        about = (
            "Towards each face of the map, the nearest cell that fails with confidence. Each folder in "
            f"{COUNTER_EXAMPLES}/ has the scenario, the report and the recording of its median failing run. The other "
            f"seed is {counter.examples[0].again.seed}, with the looks and bounds of the map."
        )
        causes = Items(tuple(_cause(example) for example in counter.examples))
        blocks += [_examples(claim, counter), Paragraph(about), causes]
    elif not any(claim.counts(name)["fails"] for name in claim.trackers):
        blocks.append(Paragraph("No cell fails with confidence."))
    else:
        blocks.append(Paragraph("None were made."))
    yield Section("Nearest counter-examples", tuple(blocks))
    if listed and counter.beyond:
        yield Section("Runs beyond the limit in cells that hold", (_beyond(claim, counter),), folded=True)


def nearest_section(claim: Claim) -> Section:
    """The nearest counter-example in a sentence, and the command that shows it; that which checks the claim else."""
    counter = claim.counter_examples
    if counter is None or not counter.examples:
        none = "None was made." if any(claim.counts(name)["fails"] for name in claim.trackers) else "No cell fails."
        commands = Code("trackbench envelope --verify claim.json", "sh")
        return Section("Nearest counter-example", (Paragraph(none), Paragraph(_NEXT), commands))
    item = min(counter.examples, key=lambda example: example.distance)
    facts = Items(
        (
            Item(f"{_value(claim, item)} at {at_point(claim, item.cell)}", item.tracker, tracker=item.tracker),
            *(Item(text, label) for label, text in (("in its run", item.event), ("where", item.condition)) if text),
        )
    )
    command = Code(f"trackbench view {COUNTER_EXAMPLES}/{item.folder}", "sh")
    return Section("Nearest counter-example", (facts, Paragraph(_NEXT), command))


def worst_section(claim: Claim) -> Iterator[Section]:
    """The worst runs that a search found."""
    if not claim.worst:
        return
    items, commands = [], []
    for run in claim.worst:
        limit = claim.limits[run.limit]
        at = ", ".join(f"{name} {value:.4g}" for name, value in zip(run.axes, run.point, strict=True))
        value = "no run has a value" if run.value is None else f"{limit.metric} {run.value:.4g} at {at or 'a seed'}"
        items.append(Item(f"{value}, found by search in {counted(run.runs, 'run')} ({limit.text})", limit.tracker))
        changes = (word for change in run.changes for word in ("--set", change))
        commands.append(shlex.join(["trackbench", "run", claim.file, *changes, "--trackers", limit.tracker]))
    about = Paragraph("Found by search: it says nothing of how often such a run happens. These commands repeat them:")
    yield Section("Worst runs", (Items(tuple(items)), about, Code("\n".join(commands), "sh")))


def at_point(claim: Claim, cell: int) -> str:
    """The values of a cell, as they are read."""
    point = claim.cells[cell].at
    return ", ".join(f"{axis.name} {axis.shown(value)}" for axis, value in zip(claim.axes, point, strict=True))


def _examples(claim: Claim, counter: CounterExamples) -> Table:
    every = counter.examples
    columns: Mapping[Column, list[Cell]] = {
        Column("tracker", left=True): [Cell(item.tracker, tracker=item.tracker) for item in every],
        Column("towards", left=True): [
            Cell(f"{item.axis} {item.side}", link=f"{COUNTER_EXAMPLES}/{item.folder}/report.html") for item in every
        ],
        Column("fails at", left=True): [Cell(at_point(claim, item.cell)) for item in every],
        Column("distance", "in shares of each range, or in units of scale"): [
            Cell(f"{item.distance:.2f}") for item in every
        ],
        Column("value", left=True): [Cell(_value(claim, item)) for item in every],
        Column("on other seeds", left=True): [Cell(_again(item)) for item in every],
    }
    return Table.of_columns("counter-examples", [*columns.items()])


def _value(claim: Claim, item: CounterExample) -> str:
    if item.limit is None:
        return item.cause
    limit = claim.limits[item.limit]
    unit = "" if limit.unit == "1" else f" {limit.unit}"
    return f"{limit.metric} {bounds(item.value, item.low, item.high)}{unit}"


def bounds(value: float | None, low: float | None, high: float | None) -> str:
    """A value with its one-sided bounds."""
    if value is None:
        return "none"
    return f"{value:.3g}" if low is None or high is None else f"{value:.3g} ({low:.3g} to {high:.3g})"


def _shown(item: CounterExample) -> str:
    shown = item.shown
    place = f"shown by run {shown.run} of scene {shown.scene}"
    if shown.value is None or shown.beyond is None:
        return f"{place}, since runs do not tell the metric"
    return f"{place}, {shown.value:.3g}, the median of the {shown.beyond} of {counted(shown.runs, 'run')} that fail"


def _again(item: CounterExample) -> str:
    again = item.again
    return f"{AGAIN[again.state]}, {bounds(again.value, again.low, again.high)}"


def _cause(item: CounterExample) -> Item:
    parts = [part for part in (_shown(item), item.event, item.condition, item.finding) if part]
    return Item(f"{item.axis} {item.side}: {'; '.join(parts)}", item.tracker)


def _beyond(claim: Claim, counter: CounterExamples) -> Table:
    rows = counter.beyond
    columns = [
        (Column("tracker", left=True), [Cell(row.tracker, tracker=row.tracker) for row in rows]),
        (Column("cell", left=True), [Cell(at_point(claim, row.cell)) for row in rows]),
        (Column("seed"), [Cell(str(claim.seed)) for _ in rows]),
        (Column("scene"), [Cell(str(row.scene)) for row in rows]),
        (Column("run"), [Cell(str(row.run)) for row in rows]),
        (Column("value"), [Cell(f"{row.value:.3g}") for row in rows]),
        (Column("limit"), [Cell(f"{claim.limits[row.limit].limit:g}") for row in rows]),
    ]
    caption = f"The furthest {len(rows)} of {counter.beyond_total}" if counter.beyond_total > len(rows) else ""
    return Table.of_columns("runs-beyond", columns, caption) if caption else Table.of_columns("runs-beyond", columns)
