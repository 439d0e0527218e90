"""Tables of a run's report (ranking, tracks, innovations, expectations), and cells that show metrics."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from trackbench.base.subjects import collected
from trackbench.document import Cell, Column, Table, Tone
from trackbench.metrics import BUILT_IN
from trackbench.metrics.covariance_words import verdict_in_words
from trackbench.metrics.registry import metric_paths
from trackbench.metrics.traffic import DETECTION_METRICS, TRACK_METRICS
from trackbench.metrics.verdicts import LEAST_COVERAGE, WHITENESS_TOLERANCE, mean_verdict
from trackbench.report.numbers import (
    NOT_AVAILABLE,
    decimals,
    half_width,
    percent_number,
    reach_text,
    rounded,
    short,
    signed,
)
from trackbench.report.pairs import Pair, Pairs, difference_word, standing
from trackbench.results import MetricValue, Result, TrackerResult

INTERVAL = "95 % interval"
VERDICT = "verdict, 95 % interval"
NO_METRIC = MetricValue(unit="1", reason="the tracker does not give what this needs")

#: Tone of each verdict.
TONE: dict[str, Tone] = {
    "consistent": "good",
    "white": "good",
    "optimistic": "bad",
    "pessimistic": "warn",
    "mixed": "warn",
    "heavy-tailed": "warn",
    "coloured": "warn",
    "undecided": "",
    "": "",
}

TRACKER = Column("tracker", left=True)
TableColumn = tuple[Column, list[Cell]]
_Row = TypeVar("_Row")


#: Tone of each outcome of an expectation.
OUTCOME_TONE: dict[str, Tone] = {"passed": "good", "undecided": "warn", "failed": "bad"}


def name_cells(trackers: Sequence[TrackerResult]) -> list[Cell]:
    """Return cells with the name of each tracker and marks, such as "reference"."""
    return [Cell(t.name, t.marks, tracker=t.name) for t in trackers]


def metric_of(tracker: TrackerResult, path: str) -> MetricValue:
    """Return the metric of a tracker at a dotted path; if there is none, a missing value with the reason."""
    return tracker.metrics.get(path, NO_METRIC)


def tone_of(metric: MetricValue) -> Tone:
    """Return the tone (good, bad, warn) of a metric's verdict; a mean shown to be too large is always bad."""
    is_optimistic = metric.dof is not None and mean_verdict(metric.ci95, metric.dof) == "optimistic"
    return "bad" if is_optimistic else TONE[metric.verdict or ""]


def metric_cells(trackers: Sequence[TrackerResult], path: str, significant: int = 3, scale: float = 1.0) -> list[Cell]:
    """Return a cell for each tracker: the metric, with equally many decimals, and verdict and interval below."""
    metrics = [metric_of(tracker, path) for tracker in trackers]
    places = decimals([None if m.value is None else scale * m.value for m in metrics], significant)
    return [_metric_cell(metric, places, scale) for metric in metrics]


def _metric_cell(metric: MetricValue, places: int, scale: float) -> Cell:
    if metric.value is None:
        return missing_cell(metric)
    ci95 = None if metric.ci95 is None else [scale * end for end in metric.ci95]
    reach = reach_text(scale * metric.value, ci95, places)
    words = verdict_in_words(metric, whole=False)
    cell = Cell(short(scale * metric.value, places), tuple(filter(None, (words, reach))))
    value = metric.without_charged
    given = () if value is None else (f"given {short(scale * value, places)}",)
    return replace(cell, details=(*cell.details, *given), tone=tone_of(metric))


def missing_cell(metric: MetricValue) -> Cell:
    return Cell(NOT_AVAILABLE, reason=metric.reason or str(NO_METRIC.reason))


def tracker_table(
    name: str, trackers: Sequence[TrackerResult], columns: Sequence[TableColumn], caption: str = ""
) -> Table:
    """Return a table with a row for each tracker: first its name, then ``columns``."""
    return Table.of_columns(name, [(TRACKER, name_cells(trackers)), *columns], caption)


def text_table(
    name: str, rows: Sequence[_Row], columns: Mapping[Column, Callable[[_Row], str]], caption: str = ""
) -> Table:
    """Return a table whose cells are texts: for each row's object, the text that each column's function gives.

    Args:
        name: name of the table's file.
        rows: one object for each row.
        columns: function from the object of a row to its text, by column; the column ``TRACKER`` holds names of
            trackers.
        caption: caption of the table.
    """

    def cell(column: Column, text: str) -> Cell:
        return Cell(text, tracker=text if column is TRACKER else "")

    cells = [tuple(cell(column, text_of(row)) for column, text_of in columns.items()) for row in rows]
    return Table(name, tuple(columns), tuple(cells), caption)


#: Metrics in the tables of runs with hidden identities.
RANKING_OF_TRACKS = (
    "tgospa", "gospa", "gospa_missed", "gospa_false", "gospa_switch", "hota",
)  # fmt: skip
MATCHED = "Errors of matched tracks"
TRACK_GROUPS: dict[str, tuple[str, ...]] = {
    "Identity": ("id_switches", "assa", "idf1"),
    "Detection": ("deta", "mota", "false_tracks", "confirm_latency", "never_confirmed", "lost_time_share"),
    MATCHED: ("gospa_localisation", "position_rmse", "velocity_rmse", "nees", "nees_inside", "matched_share"),
    "Association": (
        "association_right", "association_wrong_object", "association_clutter", "association_missed",
    ),
}  # fmt: skip
#: Acronyms in the metrics' names.
ACRONYMS = {
    "gospa": "GOSPA", "tgospa": "T-GOSPA", "hota": "HOTA", "deta": "DetA", "assa": "AssA", "idf1": "IDF1",
    "mota": "MOTA", "rmse": "RMSE", "nees": "NEES", "nis": "NIS",
}  # fmt: skip


def metric_in_words(path: str) -> str:
    """Return the name of a metric in words: "GOSPA missed"."""
    return " ".join(ACRONYMS.get(word, word) for word in path.split("_"))


def track_table(
    title: str, trackers: Sequence[TrackerResult], paths: Sequence[str], *second: TableColumn, caption: str = ""
) -> Table:
    """Return a table with a column for each metric of tracks, and the columns ``second`` after the first metric."""
    columns: list[TableColumn] = []
    for path in paths:
        metric = (TRACK_METRICS | DETECTION_METRICS)[path]
        heading = metric_in_words(path) + unit_after_heading(metric.unit)
        columns.append((Column(heading, metric.meaning, details=INTERVAL), metric_cells(trackers, path)))
    columns[1:1] = second
    return tracker_table(title.lower().replace(" ", "-").replace("'", ""), trackers, columns, caption)


def unit_after_heading(unit: str) -> str:
    """Return a unit as it follows a heading, ", m"; empty for a quantity without unit."""
    return f", {unit}" if unit != "1" else ""


def ranking_table(result: Result) -> Table:
    """Return the ranking table: metrics of the scored trackers, best first, with intervals and differences."""
    trackers, shown = result.scored, standing(result)
    differing = [(Column(shown.heading, shown.meaning, left=True), list(map(Cell, shown.cells)))]
    if len(trackers) > 1:
        differing.append(_key_differences(result))
    if result.summary.identities == "hidden":
        return track_table("Ranking", trackers, RANKING_OF_TRACKS, *differing)
    position, *further = _errors(result, trackers)
    return tracker_table("ranking", trackers, [position, *differing, *further])


def _errors(result: Result, trackers: Sequence[TrackerResult]) -> list[TableColumn]:
    label = result.summary.held_against.label
    missing = "a missing estimate counts as the last measurement or estimate, held; given: without missing estimates"
    judged = "mean, verdict under all conditions, 95 % interval"
    present = "share of the due estimates that were given"
    columns = [
        (Column("position RMSE, m", missing, details=INTERVAL), metric_cells(trackers, "position_rmse")),
        (Column("velocity RMSE, m/s", missing, details=INTERVAL), metric_cells(trackers, "velocity_rmse")),
        (
            Column(f"over {label}", f"position RMSE divided by that of the {label}", details=INTERVAL),
            metric_cells(trackers, "position_over_reference"),
        ),
        (Column("NEES, 4 expected", judged, details=VERDICT), metric_cells(trackers, "nees")),
        (
            Column("µs per step", "one predict and update of one run"),
            metric_cells(trackers, "step_time", significant=2),
        ),
    ]
    if any((metric_of(tracker, "coverage").value or 0.0) < 1.0 for tracker in trackers):
        columns.append((Column("coverage, %", present), metric_cells(trackers, "coverage", scale=100)))
    for heading, explanation, counts in (
        ("diverged", f"of {result.summary.runs} runs", [t.health.diverged_runs for t in trackers]),
        ("repaired", "covariances made positive definite again", [t.health.repaired_covariances for t in trackers]),
    ):
        if any(counts):
            columns.append((Column(heading, explanation), list(map(_fault_count, counts))))
    return columns


def _fault_count(number: int | None) -> Cell:
    return Cell(str(number or 0), tone="bad" if number else "")


#: Metrics that other tables show.
_SHOWN = ("position_rmse", "velocity_rmse", "nees", "position_over_reference", "coverage", "step_time")


def other_metrics(result: Result) -> Table | None:
    """Return a table of metrics, of plug-ins or in expectations, that no other table shows; None if there are none."""
    shown = {
        *(_SHOWN if result.summary.identities == "known" else (*TRACK_METRICS, "step_time")),
        *collected("shown_metrics", result),
    }
    expected = {item.metric for item in result.summary.expectations}
    built_in = {metric.name for metric in BUILT_IN}
    paths: dict[str, Column] = {}
    meanings = {field.name: field.meaning for field in metric_paths()}
    for path, metric in (item for tracker in result.scored for item in tracker.metrics.items()):
        if path not in shown and (path in expected or not {path, path.partition(".")[0]} & built_in):
            paths.setdefault(
                path, Column(path + unit_after_heading(metric.unit), meanings.get(path, ""), details=VERDICT)
            )
    if not paths:
        return None
    columns = [(column, metric_cells(result.scored, path)) for path, column in paths.items()]
    return tracker_table("other-metrics", result.scored, columns)


def innovation_columns(result: Result) -> Iterator[TableColumn]:
    """Yield columns on NIS and whiteness of each sensor's innovations, if any tracker gives innovations."""
    taken_in = "share of the measurements of a known object with an innovation; a late scan that is dropped has none"
    white = f"of the normalised innovations, lag 1; white within {WHITENESS_TOLERANCE} of 0"
    for sensor in result.summary.sensors:
        nis = [metric_of(tracker, f"nis.{sensor}") for tracker in result.scored]
        if all(metric.value is None for metric in nis):
            continue
        # A filter of positions has fewer degrees of freedom.
        dofs = " or ".join(map(str, sorted({metric.dof for metric in nis if metric.dof}, reverse=True)))
        yield (
            Column(f"NIS {sensor}, {dofs} expected", "mean and verdict", details="verdict"),
            _judged(result, "nis", sensor),
        )
        if any(metric.coverage is not None and metric.coverage < LEAST_COVERAGE for metric in nis):
            yield Column(f"taken in {sensor}, %", taken_in), [Cell(percent_number(m.coverage)) for m in nis]
        yield Column(f"autocorrelation {sensor}", white, details="verdict"), _judged(result, "whiteness", sensor)


def _judged(result: Result, metric: str, sensor: str) -> list[Cell]:
    """Return a cell for each tracker with NIS or whiteness at one sensor and the verdict, without interval."""
    path = f"{metric}.{sensor}"
    words = [verdict_in_words(metric_of(tracker, path)) for tracker in result.scored]
    cells = metric_cells(result.scored, path)
    return [replace(cell, details=(word,) if word else ()) for cell, word in zip(cells, words, strict=True)]


def _key_differences(result: Result) -> TableColumn:
    """Return a column of differences from the baseline or best tracker, with decimals by their uncertainty."""
    against, pairs = result.summary.score.against or result.contenders[0].name, Pairs(result)
    compared = [pairs.get(tracker.name, against) for tracker in result.scored]
    differences = [pair for pair in compared if pair]
    widths = [width for pair in differences if (width := half_width(pair.ci95))]
    places = decimals(widths, 1) if widths else decimals([pair.value for pair in differences], 2)
    cells = [
        Cell("") if tracker.name == against else _difference(pair, places)
        for tracker, pair in zip(result.scored, compared, strict=True)
    ]
    return Column(f"minus {against}, m", details=VERDICT), cells


def _difference(pair: Pair | None, places: int) -> Cell:
    if pair is None:
        return Cell(NOT_AVAILABLE, reason="the pair was not compared")
    reach = reach_text(pair.value, pair.ci95, places)
    return Cell(signed(pair.value, places), tuple(filter(None, (difference_word(pair.verdict), reach))))


def expectation_table(result: Result) -> Table:
    """Return a table of the scenario's expectations: outcome, condition and value."""
    rows = [
        (Cell(item.outcome, tone=OUTCOME_TONE[item.outcome]), Cell(item.text), Cell(value_text(item.value)))
        for item in result.summary.expectations
    ]
    columns = (Column("result", left=True), Column("expected", left=True), Column("found"))
    return Table("expectations", columns, tuple(rows))


def value_text(value: float | str | None) -> str:
    """Return the value that an expectation tests as text: a number with few digits, a word, or "n/a" for None."""
    if value is None:
        return NOT_AVAILABLE
    return rounded(value, decimals([value])) if isinstance(value, float) else str(value)
