"""Counter-examples on a page: why a tracker misses its requirement, in which run, and how to repeat it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from trackbench.base.errors import counted
from trackbench.base.execution import Executor
from trackbench.base.subjects import offered, resolve
from trackbench.document import Block, Cell, Code, Column, Item, Items, Paragraph, Row, Section, Table
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
    """Return the worst event of the run whose estimates are kept, as text; empty where there is none.

    It is the first wrong decision of an assistance function, the first track event or the largest position error.
    """
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
    """Return the assistance function that a metric belongs to; empty for any other metric."""
    label = metric.partition(".")[2]
    paths = (path for item in result.summary.trackers for path in item.metrics)
    return label if label in function_labels(paths) else ""


def finding_on(loaded: Scenario, tracker: str, executor: Executor) -> str:
    """Return what examiners such as the doctor find in a built-in tracker; empty for any other tracker."""
    if not isinstance(loaded.config.trackers[tracker], FilterConfig):
        return ""
    sentences = []
    for name, target in offered("examiners"):
        remark = next(executor.map(resolve(target), [(loaded, tracker)], own_folder(loaded)))
        sentences.append(f"the {name} finds no fault in it" if remark is None else f"the {name}: {remark}")
    return "; ".join(sentences)


def counter_section(claim: Claim, run: Result | None) -> Iterator[Section]:
    """Yield the section on a map's counter-examples; nothing where none were sought.

    ``run`` is the result of the nearest counter-example, whose scene is drawn from above; None draws no scene. If
    ``run`` has a recording, all counter-examples have recordings.
    """
    counter = claim.counter_examples
    if counter is None:
        return
    notes = [Item(f"{base.tracker}: {base.note}") for base in counter.bases if base.note]
    blocks: list[Block] = [Items(tuple(notes))] if notes else []
    if counter.examples:
        is_recorded = run is not None and run.summary.has_recording
        contents = "scenario, the report and the recording" if is_recorded else "scenario and the report"
        intro = (
            "Towards each face of the map, the nearest cell that fails with confidence. Each folder in "
            f"{COUNTER_EXAMPLES}/ has the {contents} of its median failing run."
        )
        causes = Items(tuple(_cause(example) for example in counter.examples))
        nearest = min(counter.examples, key=lambda example: example.distance)
        blocks += [_examples(claim, counter), Paragraph(intro), causes]
        if is_recorded:
            blocks.append(Paragraph("Next, in the folder of this page:"))
            blocks.append(Code(f"trackbench view {COUNTER_EXAMPLES}/{nearest.folder}", "sh"))
        blocks += _from_above(run) if run else []
    elif not any(claim.counts(name)["fails"] for name in claim.trackers):
        blocks.append(Paragraph("No cell fails with confidence."))
    else:
        blocks.append(Paragraph("None were made."))
    yield Section("Nearest counter-examples", tuple(blocks))


def _from_above(run: Result) -> Iterator[Block]:
    """Yield the figure of the nearest counter-example's recorded run, seen from above."""
    if figure := picture(run):
        yield Row((replace(figure, name="counter-example", title="The nearest counter-example from above"),))


def at_point(claim: Claim, cell: int) -> str:
    """Return the coordinates of the cell with the index ``cell`` in the claim, as text."""
    return place_of_cell(claim.axes, claim.cells[cell].at)


def _examples(claim: Claim, counter: CounterExamples) -> Table:
    examples = counter.examples
    links = [f"{COUNTER_EXAMPLES}/{item.folder}/report.html" for item in examples]
    columns = [
        (Column("tracker", left=True), [Cell(item.tracker, tracker=item.tracker) for item in examples]),
        (
            Column("towards", left=True),
            [Cell(f"{item.axis} {item.side}", link=link) for item, link in zip(examples, links, strict=True)],
        ),
        (Column("fails at", left=True), [Cell(at_point(claim, item.cell)) for item in examples]),
        (Column("distance", "in shares of each range"), [Cell(f"{item.distance:.2f}") for item in examples]),
        (Column("value", left=True), [Cell(_value_text(claim, item)) for item in examples]),
    ]
    return Table.of_columns("counter-examples", columns)


def _value_text(claim: Claim, item: CounterExample) -> str:
    tracker_state = claim.cells[item.cell].trackers[item.tracker]
    if item.limit is None:
        return tracker_state.cause
    limit = claim.limits[item.limit]
    value = tracker_state.values[claim.limits_of(item.tracker).index(limit)]
    return f"{limit.metric} {value.text}{limit.after_number}"


def _shown_run_text(item: CounterExample) -> str:
    shown = item.shown
    place = f"shown by run {shown.run} of scene {shown.scene}"
    if shown.value is None or shown.beyond is None:
        return f"{place}, since runs do not tell the metric"
    return f"{place}, {shown.value:.3g}, the median of the {shown.beyond} of {counted(shown.runs, 'run')} that fail"


def _cause(item: CounterExample) -> Item:
    parts = [part for part in (_shown_run_text(item), item.event, item.finding) if part]
    return Item(f"{item.axis} {item.side}: {'; '.join(parts)}", item.tracker)
