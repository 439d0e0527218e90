"""What a run found, for a terminal of 80 columns."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from trackbench.base.errors import counted
from trackbench.base.subjects import collected
from trackbench.document import Cell, Column, Table
from trackbench.document.terminal import STYLE, print_hanging, print_table
from trackbench.metrics.verdicts import LEAST_COVERAGE, MEANING, NAMED, mean_text, meaning, named_verdicts, what_is_off
from trackbench.report.numbers import NOT_AVAILABLE, decimals, intervals_in_short, joined_names, rounded, short
from trackbench.report.pairs import Standing, standing
from trackbench.report.scenes import basis_of_intervals, runs_in_words, undrawn_scenes, values_of_few_scenes
from trackbench.report.sentences import duration, expectations_met, remarks, value_and_limit, verdict_of_run
from trackbench.report.tables import OUTCOME_TONE, TRACKER, metric_of, tone_of
from trackbench.report.verdicts import REMARKS
from trackbench.results import MetricValue, Result, TrackerResult
from trackbench.results.scenario_summary import sentence_on_point

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
        ("T-GOSPA m", "tgospa", 3, 1.0),
        ("missed", "gospa_missed", 3, 1.0),
        ("false", "gospa_false", 3, 1.0),
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


def summary_table(result: Result) -> Table:
    """The scored trackers with the columns of the kind of result."""
    kind, trackers = "known identities", result.scored
    if result.summary.identities == "hidden":
        kind = "hidden identities" if result.summary.truth.known else "no truth"
    names = [Cell(tracker.name + "*" * tracker.is_reference, tracker=tracker.name) for tracker in trackers]
    columns = [(TRACKER, names)]
    for heading, path, digits, factor in COLUMNS[kind]:
        columns.append(
            (Column(heading, left=path == "nees" and kind == "known identities"), _cells(result, path, digits, factor))
        )
    if result.summary.truth.known and not _too_many_groups(shown := standing(result)):
        columns.insert(2, (Column(shown.short, left=True), list(map(Cell, shown.cells))))
    return Table.of_columns("summary", columns)


def _cells(result: Result, path: str, digits: int, factor: float) -> list[Cell]:
    """One metric down the column; only where identities are known is there room for an interval and a verdict."""
    trackers, labelled = result.scored, result.summary.identities == "known"
    metrics = [metric_of(tracker, path) for tracker in trackers]
    if path == "diverged_runs":
        return [Cell(str(number := t.health.diverged_runs or 0), tone="bad" if number else "") for t in trackers]
    if path == "nees":
        means = [NOT_AVAILABLE if m.mean is None else mean_text(m.mean) for m in metrics]
        width = max(map(len, means))
        # Both words fit 80 columns in this form; a note below has the whole one.
        words = [m.words.replace(", heavy-tailed", "+") * labelled for m in metrics]
        texts = [f"{mean:>{width}} {word}".rstrip() for mean, word in zip(means, words, strict=True)]
        return [Cell(text, tone=tone_of(m)) for text, m in zip(texts, metrics, strict=True)]
    values = [None if m.value is None else factor * m.value for m in metrics]
    places = decimals(values, digits)
    # The interval of a mean that few runs decide says nothing.
    shown = [MetricValue(unit=m.unit) if t.health.diverged_runs else m for t, m in zip(trackers, metrics, strict=True)]
    ends = intervals_in_short(shown, places) if path == "position_rmse" and labelled else [""] * len(metrics)
    return [Cell(f"{short(value, places)} {end}".rstrip()) for value, end in zip(values, ends, strict=True)]


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
    return [
        f"missed, false: parts of GOSPA (cutoff {cutoff:g} m); sw/min: switches per object-minute",
        f"pos. m, NEES (4 expected): of tracks within {cutoff / 2:g} m of their object",
        *(values_of_few_scenes(result) or [_intervals_of_tracks(result)]),
        *_marked(result),
    ]


def _marked(result: Result) -> list[str]:
    """What must be known of some trackers; those that are no competitors have a star."""
    return [f"*: {text}" if text in (REMARKS["reference"], REMARKS["offline"]) else text for text in remarks(result)]


def _intervals_of_tracks(result: Result) -> str:
    """Of what the intervals speak, or why the metric that ranks has none."""
    ranking = metric_of(result.scored[0], result.summary.headline)
    if ranking.ci95 is None and ranking.reason:
        return f"{result.summary.headline_name}: {ranking.reason}; the report has the intervals of other metrics"
    return f"intervals, which the report shows: {basis_of_intervals(result)}"


_MOST_LETTERS = 12


def print_summary(result: Result, console: Console) -> None:
    """The verdict, the ranked table with those that are not ranked, what it leaves out, and what was not met."""
    print_hanging(console, "", Text(verdict_of_run(result), "bold"))
    print_hanging(console, "", Text(run_in_words(result), "dim"))
    listed = result.listed
    if listed.scored:
        print_table(summary_table(listed), console, gap=1)
    _print_unranked(listed, console)
    if listed is not result:
        console.print(f"{len(result.scored) - len(listed.scored)} more: result.json", highlight=False)
    for note in _notes(result) if listed.scored else []:
        begin = len(note) - len(note.lstrip()) + 2
        print_hanging(console, Text(note[:begin], "dim"), Text(note[begin:], "dim"))
    for table in collected("tables", result):
        print_table(table, console)
    _print_missed(result, console)


def print_outcome(result: Result, console: Console) -> None:
    """One line, and what failed."""
    console.print(Text(f"{result.name}: {expectations_met(result.summary.expectations)}"), highlight=False)
    _print_unranked(result, console)
    _print_missed(result, console)


def _print_unranked(result: Result, console: Console) -> None:
    """Print why each tracker that is not ranked is not."""
    for tracker in result.unscored:
        label = Text("FAILED ", STYLE["bad"]) if tracker.failed else Text("NOT RANKED ", STYLE["warn"])
        why = f"{tracker.name}: {result.why_unscored(tracker)}{_errors_of(tracker)}"
        print_hanging(console, label, Text(why))


def _errors_of(tracker: TrackerResult) -> str:
    """ "; position RMSE 0.123 m, velocity RMSE 1.23 m/s", as far as there are any."""
    errors = [
        f"{path.replace('_rmse', ' RMSE')} {rounded(metric.value, decimals([metric.value]))} {metric.unit}"
        for path in ("position_rmse", "velocity_rmse")
        if (metric := metric_of(tracker, path)).value is not None
    ]
    return f"; {', '.join(errors)}" if errors else ""


def _print_missed(result: Result, console: Console) -> None:
    for item in result.summary.expectations:
        if not item.passed:
            mark = Text(f"  {item.outcome.upper()} ", STYLE[OUTCOME_TONE[item.outcome]])
            print_hanging(console, mark, Text(value_and_limit(item)))


def run_in_words(result: Result) -> str:
    """What was run."""
    summary = result.summary
    return f"{runs_in_words(result)}, {summary.truth.vehicles}, {duration(result)}, seed {summary.seed}"


def _too_many_groups(shown: Standing) -> bool:
    """Whether there are so many letters that they say nothing at a glance."""
    return max(map(len, shown.cells)) > _MOST_LETTERS


def _note_on_groups(result: Result) -> list[str]:
    """What the letters mean."""
    shown = standing(result)
    if _too_many_groups(shown):
        return [f"{shown.short}: too many groups for this table; report.html has them"]
    return [f"{shown.short}: {shown.meaning}"] if len(result.scored) > 1 else []


def _coverage(trackers: Sequence[TrackerResult]) -> list[str]:
    """How much some trackers gave of what they should."""
    shares = [(tracker.name, metric_of(tracker, "coverage").value or 0.0) for tracker in trackers]
    part = [f"{name} {100 * share:.1f} %" for name, share in shares if share < LEAST_COVERAGE]
    rest = "; of the others 99 % or more" if len(part) < len(trackers) else ""
    return [f"coverage: {', '.join(part)}{rest}"] if part else []


def words_explained(trackers: Sequence[TrackerResult]) -> list[str]:
    """What the verdicts on the covariances mean, but for those of which more is said; in the order of ``MEANING``."""
    lines = []
    for word in (word for word in MEANING if word not in NAMED):
        by_meaning: dict[str, list[str]] = {}
        for tracker in trackers:
            nees = metric_of(tracker, "nees")
            if nees.verdict == word:
                alone = nees.model_copy(update={"also": None})
                by_meaning.setdefault(meaning(alone, tracker.conditions), []).append(tracker.name)
        lines += [
            f"{word}{f' ({joined_names(names)})' * (len(by_meaning) > 1)}: {text}" for text, names in by_meaning.items()
        ]
    return lines


def _notes(result: Result) -> list[str]:
    """What the headings mean, where they say something, and what else a reader must know."""
    trackers, summary = result.scored, result.summary
    point = [*filter(None, [sentence_on_point(summary.score.point)])]
    if summary.identities == "hidden":
        return [*point, *(_note_on_groups(result) if summary.truth.known else []), *_notes_on_tracks(result)]
    assumed = " (white acceleration)" if summary.held_against.kind == "reference" else ""
    ends = intervals_in_short([metric_of(tracker, "position_rmse") for tracker in trackers], 0)
    sign = "± or ends" if any(end[:1] not in ("±", "") for end in ends) else "±"
    notes = [
        *point,
        f"/ref: times the {summary.held_against.label}{assumed}; diverged: of {counted(summary.runs, 'run')}",
        *_note_on_groups(result),
        *(values_of_few_scenes(result) or [f"{sign}: 95 %, {basis_of_intervals(result)}"]),
        *(undrawn_scenes(len(summary.truth.scenes), summary.truth.few_scenes_decide) if result.differences else []),
        *_coverage(trackers),
        *_marked(result),
    ]
    notes += words_explained(trackers)
    for word, heading, of in named_verdicts({tracker.name: metric_of(tracker, "nees") for tracker in trackers}):
        # One tail, or three means, fit 80 columns.
        most = 1 if word == "heavy-tailed" else 3
        beside = any(nees.verdict != word for nees in of.values())
        notes.append(f"{word}{' (+)' if beside else ''}: {heading}:")
        notes += [f"  {name}: {what_is_off(nees, most, word)}" for name, nees in of.items()]
    repaired = [(tracker.name, tracker.health.repaired_covariances) for tracker in trackers]
    notes += [f"{name}: {counted(count, 'covariance')} repaired" for name, count in repaired if count]
    for path in ("velocity_rmse", "position_over_reference", "nees"):
        metrics = [metric_of(tracker, path) for tracker in trackers]
        reasons = {metric.reason or "not given" for metric in metrics if metric.value is None}
        notes += [f"{path.replace('_', ' ')} n/a: {reason}" for reason in sorted(reasons)]
    return notes
