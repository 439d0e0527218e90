"""What a run found, for a terminal of 80 columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from rich.console import Console
from rich.text import Text

from trackbench.base.errors import counted
from trackbench.document.terminal import STYLE
from trackbench.metrics.differences import SILENCE
from trackbench.metrics.verdicts import conditions_off, mean_text
from trackbench.report.numbers import NOT_AVAILABLE, decimals, fixed, half_width, margin_words
from trackbench.report.pairs import letters
from trackbench.report.scenes import basis_of_intervals, runs_in_words
from trackbench.report.sentences import (
    common,
    duration,
    expectations_met,
    failure,
    not_called_better,
    precision_reached,
    reused_identities,
)
from trackbench.report.tables import TONE, metric_of, value_text
from trackbench.results import ExpectationResult, MetricValue, Result, TrackerResult

#: By kind of result the columns: heading, metric, significant digits, and the factor of its unit in the heading.
COLUMNS = {
    "known identities": (
        ("position m", "position_rmse", 3, 1.0),
        ("vel. m/s", "velocity_rmse", 3, 1.0),
        ("/ref", "position_over_reference", 3, 1.0),
        ("NEES", "nees", 3, 1.0),
        ("diverged", "diverged_runs", 3, 1.0),
        ("µs/step", "step_time", 2, 1.0),
    ),
    "hidden identities": (
        ("GOSPA m", "gospa", 3, 1.0),
        ("missed", "gospa_missed", 3, 1.0),
        ("false", "gospa_false", 3, 1.0),
        ("HOTA", "hota", 3, 1.0),
        ("IDF1", "idf1", 3, 1.0),
        ("sw/min", "id_switches", 2, 1.0),
        ("pos. m", "position_rmse", 3, 1.0),
        ("NEES", "nees", 2, 1.0),
        ("matched %", "matched_share", 3, 100.0),
    ),
    "no truth": (
        ("tracks", "track_count", 3, 1.0),
        ("length s", "track_length", 3, 1.0),
        ("new/min", "new_tracks", 3, 1.0),
        ("used %", "used_share", 3, 100.0),
        ("NIS", "nis", 2, 1.0),
        ("breaks", "track_breaks", 2, 1.0),
        ("own br.", "own_track_breaks", 2, 1.0),
        ("swaps", "track_swaps", 2, 1.0),
        ("score", "prediction_score", 3, 1.0),
    ),
}


def track_values(result: Result) -> list[tuple[str, list[Text]]]:
    """Each column's heading and cells."""
    kind = _kind(result)
    cells = _estimate_cells if kind == "known identities" else _track_cells
    return [(heading, cells(result.scored, path, digits, factor)) for heading, path, digits, factor in COLUMNS[kind]]


def _kind(result: Result) -> str:
    if result.summary.identities == "known":
        return "known identities"
    return "hidden identities" if result.summary.truth.known else "no truth"


def _track_cells(trackers: Sequence[TrackerResult], path: str, digits: int, factor: float) -> list[Text]:
    numbers = [None if (value := metric_of(t, path).value) is None else factor * value for t in trackers]
    places = decimals(numbers, digits)
    return [Text(_nees_in_four_letters(n) if path == "nees" else fixed(n, places)) for n in numbers]


def _estimate_cells(trackers: Sequence[TrackerResult], path: str, digits: int, _: float) -> list[Text]:
    """One metric down the column; only the position has room for its interval."""
    metrics = [metric_of(tracker, path) for tracker in trackers]
    if path == "diverged_runs":
        runs = [tracker.health.diverged_runs or 0 for tracker in trackers]
        return [Text(str(count), style=STYLE["bad"] if count else "") for count in runs]
    if path == "nees":
        return _nees(metrics)
    places = decimals([metric.value for metric in metrics], digits)
    return [Text(_short(m.value, places) + (_spread(m, places) if path == "position_rmse" else "")) for m in metrics]


def _nees_in_four_letters(value: float | None) -> str:
    """In four letters at most."""
    if value is not None and value >= 999.5:
        return ">999"
    return fixed(value, 1 if value is None or value < 99.95 else 0)


def _notes_on_tracks(result: Result) -> list[str]:
    """What the headings mean."""
    if not result.summary.truth.known:
        return [
            "There is no truth: no errors, no GOSPA, no HOTA, and no ranking; trackers stand in the scenario's order.",
            "tracks: mean number; length: median; used: share of detections; NIS: 1 when consistent",
            "breaks: our track ends and the sensor's own goes on; own br.: the other way round;",
            "swaps: both go on in other pairs; each per minute. score: of predicted detections, nats",
        ]
    cutoff = result.summary.score.cutoff_m or 0.0
    any_reference = any(tracker.is_reference for tracker in result.scored)
    return [
        f"missed, false: parts of GOSPA (cutoff {cutoff:g} m); sw/min: switches per object-minute",
        f"pos. m, NEES (4 expected): of tracks within {cutoff / 2:g} m of their object",
        *(["*: a reference, which knows which detection is whose; no competitor"] if any_reference else []),
        "intervals are in the report; they are",
        basis_of_intervals(result),
        *([reused] if (reused := reused_identities(result)) else []),
    ]


#: From here on a number is written with its power of ten.
_HUGE = 1e4
_MOST_LETTERS = 12


def print_summary(result: Result, console: Console) -> None:
    """The ranked table, what it leaves out, the expectations, and the trackers that failed."""
    console.print(_title(result), highlight=False)
    if result.scored:
        for row in _ranked(result, console.width):
            console.print(row, highlight=False, soft_wrap=True)
        for note in _notes(result):
            console.print(Text(note, style="dim"), highlight=False)
    _print_failed_trackers(result, console)
    if result.summary.expectations:
        console.print(Text(expectations_met(result.summary.expectations)), style="bold", highlight=False)
        _print_missed(result, console)


def print_outcome(result: Result, console: Console) -> None:
    """One line, and what failed."""
    outcome = f"{result.name}: {expectations_met(result.summary.expectations)}"
    console.print(Text(outcome), highlight=False)
    _print_failed_trackers(result, console)
    _print_missed(result, console)


def _print_failed_trackers(result: Result, console: Console) -> None:
    for tracker in result.unscored:
        label = ("FAILED ", STYLE["bad"]) if tracker.failed else ("NOT RANKED ", STYLE["warn"])
        console.print(Text.assemble(label, f"{tracker.name}: {failure(result, tracker)}"), highlight=False)


def _print_missed(result: Result, console: Console) -> None:
    for missed in (item for item in result.summary.expectations if not item.passed):
        console.print(_missed(missed), highlight=False)


def _title(result: Result) -> Text:
    summary, truth = result.summary, result.summary.truth
    what = f"{runs_in_words(result)}, {truth.vehicles}, {duration(result)}"
    return Text.assemble((result.name, "bold"), f": {what}, seed {summary.seed}")


@dataclass(frozen=True)
class _Column:
    heading: str
    cells: list[Text]
    right: bool = True

    @cached_property
    def width(self) -> int:
        return max(len(self.heading), *(cell.cell_len for cell in self.cells))

    def shown(self, text: Text) -> Text:
        filled = text.copy()
        filled.align("right" if self.right else "left", self.width)
        return filled


def _ranked(result: Result, width: int) -> list[Text]:
    """The table, line by line; a name that its column has no room for stands on a line of its own."""
    trackers, groups = result.scored, _groups(result)
    left_nees = result.summary.identities == "known"
    columns = [
        _Column(heading, cells, right=not (left_nees and heading == "NEES")) for heading, cells in track_values(result)
    ]
    if groups:
        columns.insert(1, _Column("group", list(map(Text, groups)), right=False))
    return _rows(trackers, columns, width)


def _rows(trackers: Sequence[TrackerResult], columns: Sequence[_Column], width: int) -> list[Text]:
    room = width - sum(1 + column.width for column in columns)
    names = [Text(tracker.name + "*" * tracker.is_reference, style="bold") for tracker in trackers]
    first = _Column("tracker", [name for name in names if len(name) <= room] or [Text()], right=False)
    rows = [_row([first, *columns], [Text(column.heading, style="dim") for column in (first, *columns)])]
    for i, name in enumerate(names):
        fits = len(name) <= room
        rows += [] if fits else [name]
        rows.append(_row([first, *columns], [name if fits else Text(), *(column.cells[i] for column in columns)]))
    return rows


def _row(columns: Sequence[_Column], cells: Sequence[Text]) -> Text:
    row = Text(" ").join(column.shown(cell) for column, cell in zip(columns, cells, strict=True))
    row.rstrip()
    return row


def _groups(result: Result) -> list[str]:
    """The letters of each tracker; nothing where there are so many that they say nothing at a glance."""
    if not result.summary.truth.known:
        return []
    found = letters(result)
    return found if max(map(len, found)) <= _MOST_LETTERS else []


def _note_on_groups(result: Result) -> list[str]:
    """What the letters mean."""
    if not _groups(result):
        return ["group: too many groups for this table; report.html has them"]
    margin = margin_words(result.summary.score.margin, "m")
    shared = f"group: no difference over {margin} shown between those that share a letter"
    return [shared, *(f"  {line}" for line in not_called_better(result))] if len(result.scored) > 1 else []


def _coverage(trackers: Sequence[TrackerResult]) -> list[str]:
    """How much some trackers gave of what they should."""
    shares = [(tracker.name, metric_of(tracker, "coverage").value or 0.0) for tracker in trackers]
    part = [f"{name} {100 * share:.1f} %" for name, share in shares if share < 1 - SILENCE]
    rest = "; of the others 99 % or more" if len(part) < len(trackers) else ""
    return [f"coverage: {', '.join(part)}{rest}"] if part else []


def _short(value: float | None, places: int) -> str:
    return fixed(value, places) if value is None or value < _HUGE else f"{value:.1e}"


def _spread(metric: MetricValue, places: int) -> str:
    width = half_width(metric)
    return "" if width is None else f" ±{_short(width, places)}"


def _nees(metrics: Sequence[MetricValue]) -> list[Text]:
    means = [NOT_AVAILABLE if m.mean is None else mean_text(m.mean) for m in metrics]
    width = max(map(len, means))
    return [
        Text.assemble((f"{mean:>{width}}", ""), (f" {m.verdict}" if m.verdict else "", STYLE[TONE[m.verdict or ""]]))
        for mean, m in zip(means, metrics, strict=True)
    ]


def _notes(result: Result) -> list[str]:
    """What the headings mean, where they say something, and what else a reader must know."""
    trackers, summary = result.scored, result.summary
    if summary.identities == "hidden":
        return [*_notes_on_tracks(result), *(_note_on_groups(result) if summary.truth.known else [])]
    assumed = " (white acceleration)" if summary.held_against.kind == "reference" else ""
    notes = [
        f"±: 95 %, {basis_of_intervals(result)}",
        f"/ref: over the {summary.held_against.label}{assumed}; diverged: of {counted(summary.runs, 'run')}",
        *_coverage(trackers),
        *([common(result).strip()] if common(result) else []),
    ]
    notes += _note_on_groups(result)
    if any(tracker.is_reference for tracker in trackers):
        notes.append("*: a smoother, which knows later measurements too; no competitor")
    if summary.precision:
        notes.append(precision_reached(summary.precision, summary.runs))
    nees = [(tracker.name, metric_of(tracker, "nees")) for tracker in trackers]
    mixed = [(name, found) for name, found in nees if found.verdict == "mixed"]
    if mixed:
        notes.append("mixed: errors larger or smaller than stated, by condition (NEES, 4 expected):")
        notes += [f"  {name}: {conditions_off(found, 3)}" for name, found in mixed]
    repaired = [(tracker.name, tracker.health.repaired_covariances) for tracker in trackers]
    notes += [f"{name}: {counted(count, 'covariance')} repaired" for name, count in repaired if count]
    for path in ("velocity_rmse", "position_over_reference", "nees"):
        metrics = [metric_of(tracker, path) for tracker in trackers]
        reasons = {metric.reason or "not given" for metric in metrics if metric.value is None}
        notes += [f"{path.replace('_', ' ')} n/a: {reason}" for reason in sorted(reasons)]
    return notes


def _missed(item: ExpectationResult) -> Text:
    return Text.assemble(("  FAILED ", STYLE["bad"]), f"{item.text}: {value_text(item.value)}")
