"""A history as a document: the results, what changed, the limits, and a figure of each metric."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from trackbench.base.errors import InputError, counted
from trackbench.compare.limits import limits_in_words
from trackbench.document import (
    Block,
    Cell,
    Column,
    Document,
    Figure,
    Item,
    Items,
    LegendEntry,
    Paragraph,
    Row,
    Section,
    Status,
    Table,
    Tone,
    TrackerStyle,
    end_of_axis,
)
from trackbench.document.drawing import INK
from trackbench.document.palette import Styles, tracker_figure, tracker_styles
from trackbench.report.comparison.sentences import LISTED, number_left_out, unit_after
from trackbench.report.junit import Suite, limit_case
from trackbench.report.numbers import NOT_AVAILABLE, decimals, half_width, joined_names, reach_text, short, signed
from trackbench.report.tables import unit_after_heading
from trackbench.results import MetricValue
from trackbench.results.metric_value import read_model
from trackbench.subjects.history.history import SCHEMA_VERSION, History, HistoryChange, HistoryEntry

_TONES: Mapping[str, Tone] = {
    "better": "good",
    "worse": "bad",
    "passed": "good",
    "failed": "bad",
    "error": "bad",
    "undecided": "warn",
}
_HEIGHT = 260.0
#: Between trackers in a figure, results.
_APART = 0.06


def history_document(history: History) -> Document:
    """The page of a history."""
    styles = tracker_styles(history.places or history.trackers)
    first, last = history.results[0].made_at, history.results[-1].made_at
    between = [f"{_day(first)} to {_day(last)}"] if first and last else []
    return Document(
        kind="history",
        title=f"History: {history.scenario}",
        facts=(counted(len(history.results), "result"), *between),
        blocks=tuple(_blocks(history, styles)),
        trackers=tuple(styles.values()),
    )


def saved_history(file: Path) -> Document:
    """The page of a history that was kept as JSON.

    Raises:
        InputError: it cannot be read, is none of this version, or scores a tracker that it does not list.
    """
    history = read_model(History, file, "history", [SCHEMA_VERSION])
    try:
        return history_document(history)
    except KeyError as error:
        raise InputError(f"it scores {error}, which is not among its trackers", file=file) from None


def _answer(history: History) -> str:
    """What changed where, the latest first, and among how many differences."""
    changes = "; ".join(
        f"{item.tracker} {item.verdict} in result {item.result}: {item.metric} {_difference(item)}"
        for item in sorted(history.changes, key=lambda item: -item.result)[:LISTED]
    )
    looked = f"of {counted(history.looks, 'difference')} that were looked at"
    return (
        f"{changes}{number_left_out(history.changes)}. Shown, {looked}."
        if changes
        else f"No change is shown, {looked}."
    )


def _difference(item: HistoryChange) -> str:
    """Such as "+0.0152 m (+15.6 ±7.0 %), 0.0974 to 0.1125"."""
    places = decimals([item.reference, item.value])
    share = "" if item.percent is None else f" ({_percent(item)} %)"
    ends = f"{short(item.reference, places)} to {short(item.value, places)}"
    return f"{signed(item.difference, places)}{unit_after(item.unit)}{share}, {ends}"


def _percent(item: HistoryChange) -> str:
    """The difference in percent of the earlier value, with half of its interval."""
    half = half_width(item.ci95)
    width = "" if half is None else f" ±{short(100 * half / abs(item.reference), 1)}"
    return f"{signed(item.percent or 0.0, 1)}{width}"


def _blocks(history: History, styles: Styles) -> Iterator[Block]:
    if history.gates:
        yield Status(limits_in_words(history.outcomes), "good" if history.passed else "bad")
    yield Paragraph(_answer(history), strong=True)
    if len(history.results) > 1:
        yield Row(tuple(history_figure(history, metric, styles) for metric in history.metrics))
    if history.changes:
        explained = Section("How it is judged", (Paragraph(_explanation(history)),), folded=True)
        yield Section("Changes", (_changes(history), explained))
    if history.gates:
        yield Section("Limits", (_gates(history),))
    if history.breaks:
        yield Section("Not comparable with the results before", (Items(tuple(_breaks(history))),))
    for metric in history.metrics:
        yield Section(f"{metric}{unit_after_heading(_unit(history, metric))}", (_values(history, metric),))
    yield Section("Results", (_results(history),))
    if history.notes:
        yield Section("Notes", (Items(tuple(map(Item, history.notes))),))


def _value(entry: HistoryEntry, tracker: str, metric: str) -> MetricValue:
    return entry.values.get(tracker, {}).get(metric, MetricValue(unit="1"))


def _unit(history: History, metric: str) -> str:
    values = (_value(entry, name, metric) for entry in history.results for name in history.trackers)
    return next((value.unit for value in values if value.value is not None), "1")


def _values(history: History, metric: str) -> Table:
    """Results down, trackers across; a value that is shown to have changed stands out."""
    changed = {(item.result, item.tracker): item for item in history.changes if item.metric == metric}
    everything = [[_value(entry, name, metric) for entry in history.results] for name in history.trackers]
    flat = [value for values in everything for value in values]
    widths = [half for value in flat if (half := half_width(value.ci95))]
    places = max(decimals([value.value for value in flat]), decimals(widths, 1) if widths else 0)
    columns = [
        (Column("result"), [Cell(str(entry.number)) for entry in history.results]),
        (Column("made (UTC)", left=True), [Cell(_minute(entry.made_at)) for entry in history.results]),
    ]
    for name, values in zip(history.trackers, everything, strict=True):
        cells = []
        for entry, value in zip(history.results, values, strict=True):
            item = changed.get((entry.number, name))
            if value.value is None:
                missing = value.reason or entry.failures.get(name, "not in this result")
                cells.append(Cell(NOT_AVAILABLE, reason=missing))
            else:
                text = " ".join(filter(None, (short(value.value, places), reach_text(value.value, value.ci95, places))))
                word = () if item is None else (item.verdict,)
                cells.append(Cell(text, word, _TONES.get("".join(word), ""), strong=item is not None))
        columns.append((Column(name, details="change"), cells))
    return Table.of_columns(f"history-{metric.replace('.', '-')}", columns, "±: 95 %")


def history_figure(history: History, metric: str, styles: Styles) -> Figure:
    """One line a tracker over the results, with its intervals; rings where it is shown to have changed."""
    names = [name for name in history.trackers if any(_value(entry, name, metric).value for entry in history.results)]
    changed = {(item.tracker, item.result) for item in history.changes if item.metric == metric}
    values = {name: [_value(entry, name, metric).value for entry in history.results] for name in names}
    highest = {name: max(value for value in own if value is not None) for name, own in values.items()}
    # Of what may be below 0, such as a delay, all is shown.
    positive = all(value is None or value >= 0 for own in values.values() for value in own)
    top = 1.25 * end_of_axis(highest.values()) if positive else 0.0
    cut = [name for name, value in highest.items() if value > top > 0]

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot()
        for i, name in enumerate(names):
            values = [_value(entry, name, metric) for entry in history.results]
            rings = [entry.number for entry in history.results if (name, entry.number) in changed]
            _line(axes, values, rings, styles[name], _APART * (i - (len(names) - 1) / 2))
        if top > 0:
            axes.set_ylim(0, top)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set(xlabel="result, the earliest first", ylabel=f"{metric}{unit_after_heading(_unit(history, metric))}")

    return tracker_figure(
        f"history-{metric.replace('.', '-')}",
        f"{metric} over the results",
        "Bars: 95 % intervals. Rings: shown to differ from the first result after the change before."
        + (f" Cut off above: {joined_names(cut)}." if cut else ""),
        f"{metric} of each tracker over the results",
        paint,
        _HEIGHT,
        [styles[name] for name in names],
        *([LegendEntry("shown to have changed", INK, "ring")] if changed else []),
    )


def _line(axes: Axes, values: Sequence[MetricValue], rings: Sequence[int], style: TrackerStyle, beside: float) -> None:
    """One tracker."""
    number = np.arange(1, len(values) + 1)
    value = np.array([np.nan if item.value is None else item.value for item in values])
    ends = np.array([item.ci95 or (np.nan, np.nan) for item in values])
    look: dict[str, Any] = {"color": style.colour, "gid": style.key}
    axes.plot(number + beside, value, linestyle=style.line, marker="o", markersize=3, **look)
    axes.vlines(number + beside, ends[:, 0], ends[:, 1], linewidth=1.2, alpha=0.6, **look)
    at = np.array(rings, dtype=int)
    axes.plot(at + beside, value[at - 1], color=INK, marker="o", markersize=9, markerfacecolor="none", linestyle="none")


def _changes(history: History) -> Table:
    items = history.changes
    places = decimals([value for item in items for value in (item.reference, item.value)])

    cells = {
        "from": [Cell(short(item.reference, places)) for item in items],
        "to": [Cell(short(item.value, places)) for item in items],
        "%": [Cell(NOT_AVAILABLE if item.percent is None else _percent(item)) for item in items],
    }
    explained = {"%": "of the earlier value, ±: 95 %"}
    columns = [
        (Column("result"), [Cell(str(item.result)) for item in items]),
        (Column("since", "the result that it differs from"), [Cell(str(item.since)) for item in items]),
        (Column("tracker", left=True), [Cell(item.tracker, tracker=item.tracker) for item in items]),
        (Column("metric", left=True), [Cell(item.metric) for item in items]),
        *((Column(name, explained.get(name, "")), column) for name, column in cells.items()),
        (Column("verdict", left=True), [Cell(item.verdict, tone=_TONES.get(item.verdict, "")) for item in items]),
        (Column("what else changed", left=True), [Cell("; ".join(item.causes) or NOTHING) for item in items]),
    ]
    return Table.of_columns("changes", columns)


def _explanation(history: History) -> str:
    ways = {item.paired_runs is None for item in history.changes}
    against = {False: "the first one with the same noise, run by run", True: "all since then together, unpaired"}
    how = ", or ".join(text for unpaired, text in against.items() if unpaired in ways)
    return (
        f"After the change before, each result is held against {how}. Shown: by more "
        "than the margin that does not matter, at a level of 5 %, corrected for "
        f"{counted(history.looks, 'difference')} (Holm). What else changed is all that the results state; "
        "it need not be the cause."
    )


#: Of what else changed with a metric.
NOTHING = "nothing that the results state"


def _breaks(history: History) -> Iterator[Item]:
    for item in history.breaks:
        names = "" if len(item.trackers) == len(history.trackers) else f" ({', '.join(item.trackers)})"
        yield Item(f"with result {item.since}: {item.reason}", label=f"result {item.result}{names}", tone="warn")


def _gates(history: History) -> Table:
    gates = history.gates
    columns = [
        (Column("tracker", left=True), [Cell(gate.tracker, tracker=gate.tracker) for gate in gates]),
        (Column("metric", left=True), [Cell(gate.metric) for gate in gates]),
        (Column("worse by at most, %"), [Cell(f"{gate.percent:g}") for gate in gates]),
        (
            Column("against result", "of the window the one that it does worst against"),
            [Cell(NOT_AVAILABLE if gate.against is None else str(gate.against)) for gate in gates],
        ),
        (Column("outcome", left=True), [Cell(gate.outcome, tone=_TONES[gate.outcome]) for gate in gates]),
        (Column("found", left=True), [Cell(gate.text) for gate in gates]),
    ]
    return Table.of_columns("limits", columns)


def _results(history: History) -> Table:
    entries = history.results
    columns = [
        (Column("result"), [Cell(str(entry.number)) for entry in entries]),
        (Column("made (UTC)", left=True), [Cell(_minute(entry.made_at)) for entry in entries]),
        (Column("commit", left=True), [Cell(_commit(entry)) for entry in entries]),
        (Column("trackbench", left=True), [Cell(entry.trackbench or NOT_AVAILABLE) for entry in entries]),
        (Column("scenario", "sha256 of its text", left=True), [Cell(entry.scenario_sha256[:8]) for entry in entries]),
        (Column("runs"), [Cell(str(entry.runs)) for entry in entries]),
        (Column("seed"), [Cell(str(entry.seed)) for entry in entries]),
        (Column("folder", left=True), [Cell(entry.folder) for entry in entries]),
    ]
    return Table.of_columns("results", columns)


def _commit(entry: HistoryEntry) -> str:
    if entry.commit is None:
        return NOT_AVAILABLE
    return entry.commit[:10] + (" (changed)" if entry.changed else "")


def _minute(made_at: str | None) -> str:
    return NOT_AVAILABLE if made_at is None else made_at[:16].replace("T", " ")


def _day(made_at: str) -> str:
    return made_at[:10]


def suite_of_history(history: History) -> Suite:
    """The limits as test cases."""
    cases = [
        limit_case(
            history.scenario,
            gate.tracker,
            gate,
            gate.text if gate.against is None else f"against result {gate.against}: {gate.text}",
            history.results[-1].folder,
        )
        for gate in history.gates
    ]
    return Suite(f"{history.scenario}: the last of {counted(len(history.results), 'result')}", cases)
