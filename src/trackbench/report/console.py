"""Summary of a run for a terminal: the answer, a table of trackers, notes and next steps."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.text import Text

from trackbench.base.errors import counted
from trackbench.base.subjects import collected
from trackbench.document import Cell, Column, Table
from trackbench.document.terminal import STYLE, print_hanging, print_table
from trackbench.metrics.covariance_words import verdict_in_words
from trackbench.metrics.verdicts import LEAST_COVERAGE, mean_text
from trackbench.report.first_screen import questions
from trackbench.report.numbers import NOT_AVAILABLE, decimals, intervals_in_short, short
from trackbench.report.pairs import Pairs, Standing, difference_word, standing
from trackbench.report.scenes import basis_of_intervals, runs_in_words, undrawn_scenes, values_of_few_scenes
from trackbench.report.sentences import (
    duration,
    expectations_met,
    remarks,
    value_and_limit,
    verdict_of_run,
    why_not_ranked,
)
from trackbench.report.tables import OUTCOME_TONE, TRACKER, metric_of, tone_of
from trackbench.report.verdicts import REMARKS
from trackbench.results import MetricValue, Result, TrackerResult
from trackbench.results.scenario_summary import sentence_on_point

#: Columns of ``--wide`` by kind of result: heading, metric, significant digits, and factor from the metric's unit.
COLUMNS = {
    "known identities": (
        ("position m", "position_rmse", 3, 1.0),
        ("vel. m/s", "velocity_rmse", 3, 1.0),
        ("/ref", "position_over_reference", 3, 1.0),
        ("NEES", "nees", 2, 1.0),
        ("µs/step", "step_time", 2, 1.0),
    ),
    "hidden identities": (
        ("T-GOSPA m", "tgospa", 3, 1.0),
        ("missed m", "gospa_missed", 3, 1.0),
        ("false m", "gospa_false", 3, 1.0),
        ("HOTA", "hota", 3, 1.0),
        ("sw/min", "id_switches", 2, 1.0),
        ("pos. m", "position_rmse", 3, 1.0),
        ("NEES", "nees", 2, 1.0),
    ),
    "no truth": (
        ("tracks", "track_count", 3, 1.0),
        ("new/min", "new_tracks", 3, 1.0),
        ("used %", "used_share", 3, 100.0),
        ("NIS", "nis", 2, 1.0),
        ("score", "prediction_score", 3, 1.0),
    ),
}
#: Columns of tracks beside T-GOSPA without ``--wide``.
OF_TRACKS = COLUMNS["hidden identities"][1:3] + COLUMNS["hidden identities"][4:5]


def kind_of(result: Result) -> str:
    """Return "known identities", "hidden identities" or "no truth", which decides the columns of the summary."""
    if result.summary.identities == "known":
        return "known identities"
    return "hidden identities" if result.summary.truth.known else "no truth"


def summary_table(result: Result, room: int = 80) -> Table:
    """Return a table of scored trackers: error, ratio to the best, and covariance verdict or parts of GOSPA.

    Args:
        result: a run with a truth.
        room: length of a line, characters, to which the words on a covariance are shortened.
    """
    trackers, path = result.scored, result.summary.headline
    values = [metric_of(tracker, path).value for tracker in trackers]
    least = min((value for value in values if value), default=1.0)
    # Two digits would tell errors that begin with a 1 apart only by 5 % or more.
    places = decimals(values, 3 if f"{least:e}"[0] == "1" else 2)
    heading = "error m" if path == "position_rmse" else f"{result.summary.headline_name} m"
    columns = [
        (TRACKER, _names(result)),
        (Column(heading), [Cell(short(value, places)) for value in values]),
        (Column("", left=True), [Cell(_bar((value or 0.0) / least)) for value in values]),
        (Column("to the best", left=True), _to_the_best(result)),
    ]
    if result.summary.identities == "hidden":
        columns += [(Column(h), _cells(result, p, digits, factor)) for h, p, digits, factor in OF_TRACKS]
    else:
        taken = sum(max(map(len, [column.heading, *(cell.text for cell in cells)])) + 1 for column, cells in columns)
        cells, judged = _covariances(trackers, room - taken), "NEES (4 is right), covariance"
        fits = taken + len(judged) <= room
        columns.append((Column(judged if fits else "covariance", "its NEES, 4 is right", left=True), cells))
    return Table.of_columns("summary", columns)


def _covariances(trackers: Sequence[TrackerResult], room: int) -> list[Cell]:
    """Return a cell for each tracker: mean NEES and verdict, and where it is off if ``room`` characters suffice."""
    metrics = [metric_of(tracker, "nees") for tracker in trackers]
    means = [NOT_AVAILABLE if nees.mean is None else mean_text(nees.mean) for nees in metrics]
    width = max(map(len, means))
    cells = []
    for tracker, nees, mean in zip(trackers, metrics, means, strict=True):
        text, short_text = (
            f"{mean:>{width}} {verdict_in_words(nees, tracker.conditions, whole=whole)}" for whole in (True, False)
        )
        cells.append(Cell((text if len(text) <= room else short_text).rstrip(), tone=tone_of(nees)))
    return cells


def wide_table(result: Result) -> Table:
    """Return a table of the scored trackers with the columns that ``--wide`` shows."""
    kind = kind_of(result)
    columns = [(TRACKER, _names(result))]
    columns += [(Column(h), _cells(result, path, digits, factor)) for h, path, digits, factor in COLUMNS[kind]]
    if result.summary.truth.known and not _too_many_groups(shown := standing(result)):
        columns.insert(2, (Column(shown.short, left=True), list(map(Cell, shown.cells))))
    return Table.of_columns("wide", columns)


def _names(result: Result) -> list[Cell]:
    return [Cell(tracker.name + "*" * tracker.is_reference, tracker=tracker.name) for tracker in result.scored]


#: Blocks of the smallest error's bar, and of the longest bar; a longer one ends in an arrow.
_LEAST, _MOST = 2, 6
_EIGHTHS = " ▏▎▍▌▋▊▉"


def _bar(ratio: float) -> str:
    """Return a bar as long as ``ratio``, an error over the smallest error: "██", "██▌", "██████▶"."""
    eighths = round(8 * _LEAST * ratio)
    if eighths > 8 * _MOST:
        return "█" * _MOST + "▶"
    return ("█" * (eighths // 8) + _EIGHTHS[eighths % 8]).rstrip()


def _to_the_best(result: Result) -> list[Cell]:
    """Return a cell for each scored tracker: its error relative to the best tracker's, and the verdict on both."""
    if not result.contenders:
        return [Cell("") for _ in result.scored]
    best, pairs, runs = result.contenders[0], Pairs(result), result.summary.runs
    least = metric_of(best, result.summary.headline).value or 0.0
    cells = []
    for tracker in result.scored:
        value, pair = metric_of(tracker, result.summary.headline).value, pairs.get(tracker.name, best.name)
        if number := tracker.health.diverged_runs:
            cells.append(Cell(f"diverged {number}/{runs}", tone="bad"))
        elif tracker is best or not value or not least:
            cells.append(Cell("    -" if tracker is best else ""))
        else:
            word = difference_word(pair.verdict) if pair and not pairs.unjudged else ""
            ratio = ratio_text(value / least)
            cells.append(Cell(f"{ratio:>5} {word}".rstrip(), tone="warn" if word == "worse" else ""))
    return cells


def ratio_text(ratio: float) -> str:
    """Return a ratio as "+26 %", from 2 on as "x2.4", from 10 on as "x12"."""
    if ratio < 2:
        return f"{100 * (ratio - 1):+.0f} %".replace("-", "\N{MINUS SIGN}")
    return f"x{ratio:.1f}" if ratio < 10 else f"x{ratio:.0f}" if ratio < 1e4 else f"x{ratio:.0e}"


def _cells(result: Result, path: str, digits: int, factor: float) -> list[Cell]:
    """Return a cell for each scored tracker with the metric at ``path``, multiplied by ``factor``."""
    trackers = result.scored
    metrics = [metric_of(tracker, path) for tracker in trackers]
    if path == "nees":
        return [Cell(NOT_AVAILABLE if m.mean is None else mean_text(m.mean), tone=tone_of(m)) for m in metrics]
    values = [None if m.value is None else factor * m.value for m in metrics]
    places = decimals(values, digits)
    # Few runs decide the mean of a tracker that diverged, so its interval says nothing.
    shown = [MetricValue(unit=m.unit) if t.health.diverged_runs else m for t, m in zip(trackers, metrics, strict=True)]
    with_intervals = path == "position_rmse" and result.summary.identities == "known"
    ends = intervals_in_short(shown, places) if with_intervals else [""] * len(metrics)
    return [Cell(f"{short(value, places)} {end}".rstrip()) for value, end in zip(values, ends, strict=True)]


def print_summary(result: Result, console: Console, folder: Path | None = None, *, wide: bool = False) -> None:
    """Print the answer, the table of trackers with notes, the expectations that are not met, and the next steps.

    Args:
        result: the run.
        console: console that prints.
        folder: folder of the run, which the commands for next steps name; None prints no next steps.
        wide: whether to print a second table with velocity errors, reference, groups of trackers and step time.
    """
    print_hanging(console, "", Text(verdict_of_run(result), "bold"))
    listed = result.listed
    if listed.scored and result.summary.truth.known:
        print_table(summary_table(listed, console.width), console, gap=1)
    if listed.scored and (wide or not result.summary.truth.known):
        print_table(wide_table(listed), console, gap=1)
    _print_unranked(listed, console)
    if listed is not result:
        console.print(f"{len(result.scored) - len(listed.scored)} more: result.json", highlight=False)
    notes = [run_in_words(result), *_notes(result)] if listed.scored else [run_in_words(result)]
    for note in [*notes, *(_wide_notes(result) if wide and listed.scored else [])]:
        begin = len(note) - len(note.lstrip()) + 2
        print_hanging(console, Text(note[:begin], "dim"), Text(note[begin:], "dim"))
    for table in collected("tables", result):
        print_table(table, console)
    _print_missed(result, console)
    if folder is not None:
        _print_next(result, folder, console)


def print_outcome(result: Result, console: Console) -> None:
    """Print how many expectations of the scenario are met, the unranked trackers, and each expectation not met."""
    console.print(Text(f"{result.name}: {expectations_met(result.summary.expectations)}"), highlight=False)
    _print_unranked(result, console)
    _print_missed(result, console)


def _print_unranked(result: Result, console: Console) -> None:
    for tracker in result.unscored:
        label = Text("FAILED ", STYLE["bad"]) if tracker.failed else Text("NOT RANKED ", STYLE["warn"])
        print_hanging(console, label, Text(f"{tracker.name}: {why_not_ranked(result, tracker)}"))


def _print_missed(result: Result, console: Console) -> None:
    for item in result.summary.expectations:
        if not item.passed:
            mark = Text(f"  {item.outcome.upper()} ", STYLE[OUTCOME_TONE[item.outcome]])
            print_hanging(console, mark, Text(value_and_limit(item)))


def _print_next(result: Result, folder: Path, console: Console) -> None:
    """Print the next questions, the recording and the report, each with its command or file."""
    steps = dict(questions(result))
    if result.summary.has_recording:
        steps["The worst moment"] = (
            f"trackbench view {shlex.quote(str(folder))}{' --worst' * result.summary.truth.known}"
        )
    if report := result.summary.artifacts.get("report"):
        steps["The report"] = str(folder / report)
    width = max(map(len, steps), default=0)
    for step, command in steps.items():
        console.print(Text.assemble((f"{step:<{width}}  ", "dim"), command), soft_wrap=True, highlight=False)


def run_in_words(result: Result) -> str:
    """Return the extent of a run: "100 noise draws of ONE scene (5 vehicles, 20.0 s), seed 7"."""
    summary = result.summary
    scene = f"{summary.truth.vehicles}, {duration(result)}"
    if summary.truth.scenes or summary.runs == 1 or (summary.truth.model_extra or {}).get("random"):
        return f"{runs_in_words(result)} ({scene}), seed {summary.seed}"
    return f"{summary.runs} noise draws of ONE scene ({scene}), seed {summary.seed}"


#: Letters of groups that a reader takes in at a glance.
_MOST_LETTERS = 12


def _too_many_groups(shown: Standing) -> bool:
    return max(map(len, shown.cells)) > _MOST_LETTERS


def _coverage(trackers: Sequence[TrackerResult]) -> list[str]:
    """Return a note on the trackers that gave too few of the due estimates."""
    shares = [(tracker.name, metric_of(tracker, "coverage").value or 0.0) for tracker in trackers]
    part = [f"{name} {100 * share:.1f} %" for name, share in shares if share < LEAST_COVERAGE]
    rest = "; all others 99 % or more" if len(part) < len(trackers) else ""
    return [f"coverage: {', '.join(part)}{rest}"] if part else []


def _notes(result: Result) -> list[str]:
    """Return the notes under the summary: scored point, divergence, headings, coverage, remarks and repairs."""
    trackers, summary = result.scored, result.summary
    remarked = [
        f"*: {text}" if text in (REMARKS["reference"], REMARKS["offline"]) else text for text in remarks(result)
    ]
    notes = [*filter(None, [sentence_on_point(summary.score.point)])]
    if summary.score.divergence_m and any(tracker.health.diverged_runs for tracker in trackers):
        notes.append(f"diverged: number of runs with an error above {summary.score.divergence_m:g} m")
    if not summary.truth.known:
        return [*notes, *_NO_TRUTH, *remarked]
    if summary.identities == "hidden":
        notes.append(
            f"missed, false: parts of GOSPA, m (cutoff {summary.score.cutoff_m or 0.0:g} m); "
            "sw/min: identity switches of an object in a minute"
        )
    notes += [*values_of_few_scenes(result), *(_coverage(trackers) if summary.identities == "known" else []), *remarked]
    repaired = [(tracker.name, tracker.health.repaired_covariances) for tracker in trackers]
    return notes + [f"{name}: {counted(count, 'covariance')} repaired" for name, count in repaired if count]


_NO_TRUTH = (
    "There is no truth: no errors, no GOSPA, no HOTA, and no ranking; trackers stand in the scenario's order.",
    "tracks: mean number; used: share of detections; NIS: 1 when consistent;",
    "score: of predicted detections, nats",
)


def _wide_notes(result: Result) -> list[str]:
    """Return notes on the wide table: meaning of headings, basis of intervals, reasons for missing values."""
    trackers, summary = result.scored, result.summary
    notes = []
    if summary.truth.known:
        shown = standing(result)
        meaning = "too many groups for this table; report.html has them" if _too_many_groups(shown) else shown.meaning
        notes += [f"{shown.short}: {meaning}"] * (len(trackers) > 1)
    if summary.identities == "hidden":
        return notes
    assumed = " (white acceleration)" if summary.held_against.kind == "reference" else ""
    notes.append(f"/ref: relative to the {summary.held_against.label}{assumed}; ±: 95 %, {basis_of_intervals(result)}")
    if result.differences:
        notes += undrawn_scenes(len(summary.truth.scenes), summary.truth.few_scenes_decide)
    for path in ("velocity_rmse", "position_over_reference", "nees"):
        metrics = [metric_of(tracker, path) for tracker in trackers]
        reasons = {metric.reason or "not given" for metric in metrics if metric.value is None}
        notes += [f"{path.replace('_', ' ')} n/a: {reason}" for reason in sorted(reasons)]
    return notes
