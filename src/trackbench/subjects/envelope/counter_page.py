"""What a page says of counter-examples: why a tracker misses its requirement, in which run, and how to repeat it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from trackbench.base.errors import counted
from trackbench.base.execution import Executor
from trackbench.base.subjects import offered, resolve
from trackbench.document import Block, Cell, Code, Column, Item, Items, Paragraph, Row, Section, Table
from trackbench.document.palette import tracker_styles
from trackbench.metrics.function_events import events_of, function_events, function_labels
from trackbench.report.first_screen import picture
from trackbench.report.moments import moment_text, worst_moments
from trackbench.results import Result
from trackbench.scenario import Scenario
from trackbench.scenario.load import own_folder
from trackbench.subjects.envelope.claim import Claim, place_of_cell
from trackbench.subjects.envelope.counter_models import COUNTER_EXAMPLES, CounterExample, CounterExamples
from trackbench.trackers.config import FilterConfig


def event_of(result: Result, tracker: str, metric: str = "") -> str:
    """What went wrong most in the recorded run; empty where nothing did, or nothing is known of it."""
    if label := _function(result, metric):
        decided = next(iter(function_events(result, label, tracker, result.summary.recorded_run)), None)
        if decided is None:
            return ""
        where = f" at {decided.object}" if decided.object else ""
        return f"{label} {decided.word}{where} at {decided.time_s:.2f} s, by {decided.wrong_s:.2f} s"
    if result.summary.identities == "hidden":
        first = next(iter(events_of(result, tracker, result.summary.recorded_run)), None)
        return "" if first is None else f"{first.kind} at {first.time_s:.2f} s, {first.reason}"
    moment = worst_moments(result).get(tracker)
    return "" if moment is None else f"position error {moment_text(moment)}"


def _function(result: Result, metric: str) -> str:
    """The function that a metric is of; empty where it is of none."""
    label = metric.partition(".")[2]
    paths = (path for item in result.summary.trackers for path in item.metrics)
    return label if label in function_labels(paths) else ""


def finding_on(loaded: Scenario, tracker: str, executor: Executor) -> str:
    """What the subjects that examine trackers say of a built-in one; empty of any other."""
    if not isinstance(loaded.config.trackers[tracker], FilterConfig):
        return ""
    sentences = []
    for name, target in offered("examiners"):
        remark = next(executor.map(resolve(target), [(loaded, tracker)], own_folder(loaded)))
        sentences.append(f"the {name} finds no fault in it" if remark is None else f"the {name}: {remark}")
    return "; ".join(sentences)


def counter_section(claim: Claim, run: Result | None = None) -> Iterator[Section]:
    """Yield the nearest counter-examples of a map, with their causes; nothing where none were looked for.

    Args:
        claim: of the map.
        run: of the nearest one, which is shown from above.
    """
    counter = claim.counter_examples
    if counter is None:
        return
    notes = [Item(f"{base.tracker}: {base.note}") for base in counter.bases if base.note]
    blocks: list[Block] = [Items(tuple(notes))] if notes else []
    if counter.examples:
        about = (
            "Towards each face of the map, the nearest cell that fails with confidence. Each folder in "
            f"{COUNTER_EXAMPLES}/ has the scenario, the report and the recording of its median failing run."
        )
        causes = Items(tuple(_cause(example) for example in counter.examples))
        nearest = min(counter.examples, key=lambda example: example.distance)
        blocks += [_examples(claim, counter), Paragraph(about), causes, Paragraph("Next, in the folder of this page:")]
        blocks.append(Code(f"trackbench view {COUNTER_EXAMPLES}/{nearest.folder}", "sh"))
        blocks += _from_above(run) if run else []
    elif not any(claim.counts(name)["fails"] for name in claim.trackers):
        blocks.append(Paragraph("No cell fails with confidence."))
    else:
        blocks.append(Paragraph("None were made."))
    yield Section("Nearest counter-examples", tuple(blocks))


def _from_above(run: Result) -> Iterator[Block]:
    """Yield the recorded run of the nearest counter-example from above."""
    styles = tracker_styles(run.places)
    moments = worst_moments(run) if run.summary.identities == "known" else {}
    figure = picture(run, [styles[tracker.name] for tracker in run.drawn], moments)
    if figure:
        yield Row((replace(figure, name="counter-example", title="The nearest counter-example from above"),))


def at_point(claim: Claim, cell: int) -> str:
    """The values of a cell, as they are read."""
    return place_of_cell(claim.axes, claim.cells[cell].at)


def _examples(claim: Claim, counter: CounterExamples) -> Table:
    every = counter.examples
    links = [f"{COUNTER_EXAMPLES}/{item.folder}/report.html" for item in every]
    columns = [
        (Column("tracker", left=True), [Cell(item.tracker, tracker=item.tracker) for item in every]),
        (
            Column("towards", left=True),
            [Cell(f"{item.axis} {item.side}", link=link) for item, link in zip(every, links, strict=True)],
        ),
        (Column("fails at", left=True), [Cell(at_point(claim, item.cell)) for item in every]),
        (Column("distance", "in shares of each range"), [Cell(f"{item.distance:.2f}") for item in every]),
        (Column("value", left=True), [Cell(_value(claim, item)) for item in every]),
    ]
    return Table.of_columns("counter-examples", columns)


def _value(claim: Claim, item: CounterExample) -> str:
    own = claim.cells[item.cell].trackers[item.tracker]
    if item.limit is None:
        return own.cause
    limit = claim.limits[item.limit]
    value = own.values[claim.limits_of(item.tracker).index(limit)]
    return f"{limit.metric} {value.text}{limit.after_number}"


def _shown(item: CounterExample) -> str:
    shown = item.shown
    place = f"shown by run {shown.run} of scene {shown.scene}"
    if shown.value is None or shown.beyond is None:
        return f"{place}, since runs do not tell the metric"
    return f"{place}, {shown.value:.3g}, the median of the {shown.beyond} of {counted(shown.runs, 'run')} that fail"


def _cause(item: CounterExample) -> Item:
    parts = [part for part in (_shown(item), item.event, item.finding) if part]
    return Item(f"{item.axis} {item.side}: {'; '.join(parts)}", item.tracker)
