"""The section on functions: their decisions on the tracks against those on the truth, as numbers and over time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from trackbench.base.types import Array
from trackbench.document import Cell, Column, Figure, LegendEntry, Paragraph, Row, Section, Table, TrackerStyle
from trackbench.document.drawing import DASHED, GRID, INK, MUTED, TIME_LABEL, shortened_to_width, time_axis
from trackbench.metrics.function_events import FunctionEvent, function_events, function_labels
from trackbench.report.numbers import NOT_AVAILABLE, decimals, intervals_in_short, joined_names, rounded, short
from trackbench.report.pairs import Pairs
from trackbench.report.sentences import some_names
from trackbench.report.tables import (
    INTERVAL,
    TRACKER,
    TableColumn,
    metric_cells,
    metric_of,
    text_table,
    tracker_table,
    unit_after_heading,
)
from trackbench.results import MetricValue, Result, TrackerResult
from trackbench.results.columns import split

#: Number of worst events of each function that are listed.
LISTED = 5
_MEANING = (
    "Each function decides on the truth and on each tracker's tracks at every instant. An event is a time in which it "
    "is active on the truth. The delay is that of its activity on the tracks, below 0 where it comes early; of a "
    "missed event it is the time to the impact, or to 0.5 s after the end. False is activity on the tracks that begins "
    "more than 0.5 s from every event, or is over before it, per hour of the drive. The figure is of the recorded run, "
    "the numbers are of all."
)
#: Columns of each function: first part of the metric's name, heading, and factor from the metric to the column.
_COLUMNS = (
    ("warn_delay", "delay, s", 1.0),
    ("warn_error", "RMS delay, s", 1.0),
    ("missed_warnings", "missed, %", 100.0),
    ("false_warnings", "false, 1/h", 1.0),
)
#: Columns of a delay beside its mean.
_OF_DELAY = {
    "early": Column("early, s", "mean of the delays below 0"),
    "late": Column("late, s", "mean of the delays above 0"),
    "p05": Column("5 %, s", "5 % of the delays are below it"),
    "p50": Column("50 %, s", "half of the delays are below it"),
    "p95": Column("95 %, s", "95 % of the delays are below it"),
}


def functions_section(result: Result, shown: Sequence[TrackerStyle]) -> Iterator[Section]:
    """Yield a section with each assistance function's decisions, metrics and events; nothing without functions."""
    labels = function_labels(path for tracker in result.scored for path in tracker.metrics)
    if labels:
        parts = (_one_function(result, label, shown) for label in labels)
        yield Section("Functions", (Paragraph(_MEANING), *parts))


def _one_function(result: Result, label: str, shown: Sequence[TrackerStyle]) -> Section:
    events = function_events(result, label)
    run = result.summary.recorded_run
    decisions = result.tables.if_there("decisions")
    strip = strip_of_decisions(decisions, [event for event in events if event.run == run], label, shown, run)
    worst = _worst(events[:LISTED], label) if events else None
    beside = tuple(block for block in (strip, worst) if block is not None)
    return Section(label, (*([Row(beside)] if beside else []), _metrics_table(result, label)))


def _metrics_table(result: Result, label: str) -> Table:
    trackers = result.scored
    metrics = {item.name: item for item in result.summary.score.metrics}
    paths = [path for path in metrics if path.rpartition(".")[2] == label and path in trackers[0].metrics]
    columns_of = {f"{stem}.{label}": (heading, scale) for stem, heading, scale in _COLUMNS}

    def cells(path: str) -> TableColumn:
        metric = metrics[path]
        heading, scale = columns_of.get(
            path, (path.partition(".")[0].replace("_", " ") + unit_after_heading(metric.unit), 1.0)
        )
        return Column(heading, metric.meaning, details=INTERVAL), metric_cells(trackers, path, scale=scale)

    delays = [(column, _details(trackers, f"warn_delay.{label}", name)) for name, column in _OF_DELAY.items()]
    mean, *others = map(cells, paths)
    return tracker_table(f"{label}-decisions", trackers, [mean, *delays, *others])


def function_tables(result: Result) -> Iterator[Table]:
    """Yield terminal tables of assistance functions: metrics that all have, then metrics of single functions."""
    labels = function_labels(path for tracker in result.scored for path in tracker.metrics)
    if not labels:
        return
    trackers = result.scored
    rows = [(label, tracker) for label in labels for tracker in trackers]
    common: list[TableColumn] = [
        (Column("function", left=True), [Cell(label) for label, _ in rows]),
        (TRACKER, [Cell(tracker.name, tracker=tracker.name) for _, tracker in rows]),
    ]
    for stem, heading, scale in _COLUMNS:
        common.append((Column(heading), _in_short([metric_of(t, f"{stem}.{label}") for label, t in rows], scale)))
    yield Table.of_columns("functions", common, "Functions on the tracks against those on the truth")
    stems = {stem for stem, *_ in _COLUMNS}
    single = [
        (
            Column(f"{label} {stem.replace('_', ' ')}{unit_after_heading(item.unit)}"),
            _in_short([metric_of(t, item.name) for t in trackers]),
        )
        for item in result.summary.score.metrics
        for stem, _, label in [item.name.rpartition(".")]
        if label in labels and stem not in stems and item.name in trackers[0].metrics
    ]
    if single:
        yield tracker_table("function-errors", trackers, single)


def shown_metrics(result: Result) -> Iterator[str]:
    """Yield the names of the metrics of driver assistance functions, such as ``warn_delay.fcw``."""
    paths = dict.fromkeys(path for tracker in result.scored for path in tracker.metrics)
    labels = function_labels(paths)
    return (path for path in paths if path.partition(".")[2] in labels)


def smallest_delays(result: Result) -> Iterator[str]:
    """Yield a clause on the trackers with the smallest delay, for the functions that have an expectation."""
    expected = {item.metric.rpartition(".")[2] for item in result.summary.expectations}
    closest: dict[tuple[str, str], list[str]] = {}
    for label in function_labels(path for tracker in result.scored for path in tracker.metrics):
        contenders = [(tracker.name, metric_of(tracker, f"warn_error.{label}").value) for tracker in result.contenders]
        errors = {name: value for name, value in contenders if value is not None}
        if label in expected and errors:
            names, values = zip(*_not_shown_worse(result, f"warn_error.{label}", errors), strict=True)
            who = "all trackers" if len(names) == len(contenders) > 1 else some_names(names)
            ends = dict.fromkeys(rounded(end, decimals(values[:1], 2)) for end in (values[0], values[-1]))
            unlike = ", same or not shown" if values[0] < values[-1] else ""
            closest.setdefault((who, unlike), []).append(f"{' to '.join(ends)} s ({label})")
    if closest:
        texts = [f"{who} {joined_names(delays)}{unlike}" for (who, unlike), delays in closest.items()]
        yield f"smallest RMS delay: {', '.join(texts)}"


def _not_shown_worse(result: Result, path: str, errors: Mapping[str, float]) -> list[tuple[str, float]]:
    """Return the tracker with the smallest error and the trackers not shown to differ, with their errors, ascending."""
    first, *others = sorted(errors, key=lambda name: errors[name])
    pairs = Pairs(result, path)
    return [(name, errors[name]) for name in (first, *others) if name == first or not pairs.differ(first, name)]


def _in_short(metrics: Sequence[MetricValue], scale: float = 1.0) -> list[Cell]:
    numbers = [None if metric.value is None else scale * metric.value for metric in metrics]
    places = decimals(numbers, 2)
    written = zip(metrics, numbers, intervals_in_short(metrics, places, scale), strict=True)
    return [
        Cell(f"{short(number, places)} {ends}".rstrip(), reason=(m.reason or "") if number is None else "")
        for m, number, ends in written
    ]


def _details(trackers: Sequence[TrackerResult], path: str, name: str) -> list[Cell]:
    numbers = [getattr(metric_of(tracker, path), name) for tracker in trackers]
    places = decimals(numbers)
    missing = Cell(NOT_AVAILABLE, reason="there is no such delay")
    return [missing if number is None else Cell(rounded(number, places)) for number in numbers]


def _worst(events: Sequence[FunctionEvent], label: str) -> Table:
    columns = {
        TRACKER: lambda event: event.tracker,
        Column("run"): lambda event: str(event.run),
        Column("time, s"): lambda event: rounded(event.time_s, 2),
        Column("object", left=True): lambda event: event.object or "none",
        Column("what", left=True): lambda event: event.word,
        Column("by, s"): lambda event: rounded(event.wrong_s, 2),
    }
    return text_table(f"{label}-events", events, columns, "The worst events of all runs")


#: Height of a row, and of the room around the rows, in points.
_ROW, _AROUND = 20.0, 44.0
#: Half the height of a bar, and of a mark for late or missed, in rows.
_BAR, _LATE = 0.34, 0.12


def strip_of_decisions(
    decisions: pa.Table, events: Sequence[FunctionEvent], function: str, styles: Sequence[TrackerStyle], run: int
) -> Figure | None:
    """Return a figure of a function's activity over time, on the truth and on each tracker's tracks; None without any.

    ``events`` are the function's events in the recorded run; ``styles`` are ordered with the best tracker first.
    """
    rows = {
        tracker: columns
        for (tracker, name), columns in split(decisions, "tracker", "function").items()
        if name == function
    }
    shown = [style for style in styles if style.name in rows]
    if not any(rows[style.name][name].any() for style in shown for name in ("active", "true_active")):
        return None
    first = rows[shown[0].name]
    time, hit = first["time_s"], np.flatnonzero(first["impact"])
    truth = active_spans(time, first["true_active"])

    def paint(canvas: Canvas) -> None:
        axes = canvas.add_subplot(xlabel=TIME_LABEL)
        axes.grid(visible=False)
        axes.broken_barh([(a, b - a) for a, b in truth], (-_BAR, 2 * _BAR), facecolors=INK)
        axes.vlines([a for a, _ in truth], -_BAR, len(shown) + 0.5, color=MUTED, linestyle=DASHED, linewidth=0.8)
        for number, style in enumerate(shown, start=1):
            axes.axhline(number, color=GRID, linewidth=0.6, zorder=0.5)
            bars = active_spans(time, rows[style.name]["active"])
            axes.broken_barh([(a, b - a) for a, b in bars], (number - _BAR, 2 * _BAR), facecolors=style.colour)
            _draw_events(axes, number, [event for event in events if event.tracker == style.name])
        axes.vlines(time[hit[:1]], -0.5, len(shown) + 0.5, color=INK, linewidth=2)
        axes.set_ylim(len(shown) + 0.6, -0.6)
        labels = ["truth", *(shortened_to_width(style.name, 90, 9) for style in shown)]
        axes.set_yticks(range(len(labels)), labels, fontsize=9)
        time_axis(axes, float(time[-1]))

    impact = f" An object touches the ego from {rounded(time[hit[0]], 2)} s on." if len(hit) else ""
    return Figure(
        f"decisions-{function}",
        f"Decisions of {function}",
        f"Run {run}. A bar is a time in which it is active. Below the truth, on the tracks of each tracker: a thin bar "
        "is the time by which it is late, a cross a missed event, a triangle activity without an event.",
        f"Active on the truth {_in_words(truth)}.{impact} {_mistakes(shown, events)}",
        paint,
        _ROW * (len(shown) + 1) + _AROUND,
        legend=(
            LegendEntry("active", INK, "box"),
            LegendEntry("late", INK, "line"),
            LegendEntry("missed", INK, "cross"),
            LegendEntry("false", INK, "triangle"),
            *([LegendEntry("impact", INK, "upright")] if len(hit) else []),
        ),
    )


def active_spans(time: Array, active: Array) -> list[tuple[float, float]]:
    """Return start and end of each interval of activity, s; the end is the next inactive instant, or the last one."""
    change = np.diff(np.concatenate([[0.0], active, [0.0]]))
    ends = np.append(time, time[-1])
    return list(zip(time[np.flatnonzero(change > 0)].tolist(), ends[np.flatnonzero(change < 0)].tolist(), strict=True))


def _draw_events(axes: Axes, row: int, events: Iterable[FunctionEvent]) -> None:
    for event in events:
        start, until, word = event.time_s, event.until_s, event.word
        if word in ("late", "missed"):
            axes.broken_barh([(start, event.wrong_s)], (row - _LATE, 2 * _LATE), facecolors=INK)
        if word == "missed":
            axes.plot((start + until) / 2, row, color=INK, marker="x", markersize=9, markeredgewidth=2)
        if word == "false":
            axes.plot((start + until) / 2, row, color=INK, marker="^", markersize=8)


def _in_words(spans: Sequence[tuple[float, float]]) -> str:
    if not spans:
        return "never"
    return joined_names([f"from {rounded(start, 2)} s to {rounded(stop, 2)} s" for start, stop in spans])


def _mistakes(shown: Sequence[TrackerStyle], events: Sequence[FunctionEvent]) -> str:
    sentences = []
    for style in shown:
        texts = [f"{event.word} by {rounded(event.wrong_s, 2)} s" for event in events if event.tracker == style.name]
        sentences.append(f"{style.name}: {', '.join(texts) or 'nothing wrong'}.")
    return " ".join(sentences)
