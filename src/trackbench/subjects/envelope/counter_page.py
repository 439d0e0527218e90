"""What a page says of counter-examples: why a tracker misses its requirement, in which run, and how to repeat it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from trackbench.base.errors import counted
from trackbench.base.execution import Executor
from trackbench.base.subjects import offered, resolve
from trackbench.document import Block, Cell, Code, Column, Item, Items, Paragraph, Section, Table
from trackbench.metrics.function_events import FunctionEvent, events_of, function_events, function_labels
from trackbench.metrics.recorded_run import estimates_at
from trackbench.report.moments import moment_text, worst_moments
from trackbench.results import ConditionScores, Result
from trackbench.scenario import Scenario
from trackbench.scenario.load import own_folder
from trackbench.subjects.envelope.claim import Claim, place_of_cell
from trackbench.subjects.envelope.counter_models import COUNTER_EXAMPLES, CounterExample, CounterExamples
from trackbench.trackers.config import FilterConfig

#: A condition stands out if it has at least this many times the squared error of its share of the estimates.
STANDS_OUT = 1.2
#: And at least this share of all.
LEAST = 0.1


def condition_of(result: Result, tracker: str, metric: str = "") -> str:
    """What carries the error: a manoeuvre or a range band; of tracks, the kind of event. Empty where none stands out,
    and of a function.

    Args:
        result: of all runs.
        tracker: its name.
        metric: that is not met.
    """
    if _function(result, metric):
        return ""
    if result.summary.identities == "hidden":
        return _dearest_kind(result, tracker)
    scores = result[tracker].breakdown
    if scores is None or not scores.all.count:
        return ""
    carriers = (_carrier(group, scores.all) for group in (scores.manoeuvre, scores.range))
    return ", ".join(text for text in carriers if text)


def _carrier(group: Mapping[str, ConditionScores], every: ConditionScores) -> str:
    """Of manoeuvres, or of range bands, the one that carries most beyond its share of the estimates."""
    total = _squares(every)
    shares = [(_squares(item) / total, item.count / every.count, name) for name, item in group.items() if total]
    carried, count, name = max(shares, key=lambda share: share[0] - share[1], default=(0.0, 1.0, ""))
    if carried < max(STANDS_OUT * count, LEAST):
        return ""
    return f"{name}: {100 * carried:.0f} % of the squared position error in {100 * count:.0f} % of the estimates"


def _squares(scores: ConditionScores) -> float:
    value = None if scores.position_rmse is None else scores.position_rmse.value
    return 0.0 if value is None else scores.count * value**2


def _dearest_kind(result: Result, tracker: str) -> str:
    costs: dict[tuple[str, str], float] = {}
    for event in events_of(result, tracker):
        costs[event.kind, event.cause] = costs.get((event.kind, event.cause), 0.0) + event.cost_m2
    total = sum(costs.values())
    if not total:
        return ""
    (kind, why), cost = max(costs.items(), key=lambda item: item[1])
    return f"{kind}, {why}: {100 * cost / total:.0f} % of the cost of all events"


def event_of(result: Result, tracker: str, metric: str = "") -> str:
    """What went wrong most in the recorded run; empty where nothing did, or nothing is known of it."""
    if label := _function(result, metric):
        decided = next(iter(function_events(result, label, tracker, result.summary.recorded_run)), None)
        if decided is None:
            return ""
        where = f" at {decided.object}" if decided.object else ""
        text = f"{label} {decided.word}{where} at {decided.time_s:.2f} s, by {decided.wrong_s:.2f} s"
        return ", ".join([text, *_errors_at(result, tracker, decided)])
    if result.summary.identities == "hidden":
        first = next(iter(events_of(result, tracker, result.summary.recorded_run)), None)
        return "" if first is None else f"{first.kind} at {first.time_s:.2f} s, {first.reason}"
    moment = worst_moments(result).get(tracker)
    return "" if moment is None else f"position error {moment_text(moment)}"


def _errors_at(result: Result, tracker: str, event: FunctionEvent) -> Iterator[str]:
    """The errors of the estimate of the object when the function was due: later ones did not decide it."""
    for estimate in estimates_at(result, event.time_s):
        if (estimate.tracker, estimate.object) == (tracker, event.object) and estimate.velocity_error_mps is not None:
            position, velocity = estimate.position_error_m or 0.0, estimate.velocity_error_mps
            yield f"with a position error of {position:.2f} m and a velocity error of {velocity:.2f} m/s then"


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
    """The nearest counter-example in a sentence, and the command that shows it."""
    counter = claim.counter_examples
    if counter is None or not counter.examples:
        none = "None was made." if any(claim.counts(name)["fails"] for name in claim.trackers) else "No cell fails."
        return Section("Nearest counter-example", (Paragraph(none),))
    item = min(counter.examples, key=lambda example: example.distance)
    facts = Items(
        (
            Item(f"{_value(claim, item)} at {at_point(claim, item.cell)}", item.tracker, tracker=item.tracker),
            *(Item(text, label) for label, text in (("in its run", item.event), ("where", item.condition)) if text),
        )
    )
    command = Code(f"trackbench view {COUNTER_EXAMPLES}/{item.folder}", "sh")
    return Section("Nearest counter-example", (facts, Paragraph(_NEXT), command))


def at_point(claim: Claim, cell: int) -> str:
    """The values of a cell, as they are read."""
    return place_of_cell(claim.axes, claim.cells[cell].at)


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
    return f"{limit.metric} {bounds(item.value, item.low, item.high)}{limit.after_number}"


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
