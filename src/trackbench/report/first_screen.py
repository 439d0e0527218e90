"""The first screen of a run's report: the answer, the expectations, a small ranking, and the scene from above."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

from trackbench.base.errors import counted
from trackbench.document import (
    Block,
    Cell,
    Code,
    Column,
    Figure,
    Item,
    Items,
    Paragraph,
    Section,
    Status,
    Table,
    Tone,
)
from trackbench.document.palette import tracker_styles
from trackbench.metrics.covariance_words import verdict_in_words
from trackbench.metrics.verdicts import mean_verdict
from trackbench.report import tables
from trackbench.report.figures.map import map_of_scene
from trackbench.report.moments import moment_text, worst_moments
from trackbench.report.numbers import decimals, reach_text, rounded
from trackbench.report.pairs import Pairs
from trackbench.report.replay import replay_of_run
from trackbench.report.sentences import answer_of_run, divergence, expectations_met, value_and_limit, why_not_ranked
from trackbench.report.tables import INTERVAL, metric_of, missing_cell, tone_of, tracker_table
from trackbench.report.verdicts import NEXT
from trackbench.results import MetricValue, Result, Summary, TrackerResult


def picture(result: Result) -> Figure | None:
    """Return the map of the recorded run: best and last of the trackers in figures, and the user's own trackers.

    None if there is no truth or, with hidden identities, no tracker. Baselines and references are not in the map.
    """
    is_hidden = result.summary.identities == "hidden"
    styles = tracker_styles(result.places)
    shown = {tracker.name: styles[tracker.name] for tracker in result.drawn}
    trackers = [tracker for tracker in result.filtering if tracker.name in shown]
    if not result.summary.truth.known or (is_hidden and not trackers):
        return None
    names = [tracker.name for tracker in trackers if tracker.is_own or tracker in (trackers[0], trackers[-1])]
    moments = {} if is_hidden else worst_moments(result)
    scene = replay_of_run(result, list(shown.values()), names, moments)
    errors = "; ".join(moment_text(moments[name]) for name in names if name in moments)
    caption = f"Run {result.summary.recorded_run}.{f' Largest errors: {errors}.' * bool(errors)}"
    return map_of_scene(scene, caption) if scene else None


def first_screen(result: Result, total: int, picture: Figure | None) -> Iterator[Block]:
    """Yield the top of a report: answer, expectations, a small ranking of ``total`` trackers, and ``picture``."""
    summary, missing = result.summary, result.unscored
    answer = answer_of_run(result)
    # A tracker's name keeps its small letter.
    answer = answer[0].upper() + answer[1:] if answer.startswith("over ") else answer
    yield Paragraph(f"{answer}.", strong=True)
    outcomes = {item.outcome for item in summary.expectations}
    tone: Tone = next((tone for word, tone in reversed(tables.OUTCOME_TONE.items()) if word in outcomes), "")
    yield Status(expectations_met(summary.expectations), tone)
    if missing:
        yield Status(f"{counted(len(missing), 'tracker')} not ranked", "bad")
    if failed := [item for item in summary.expectations if item.outcome == "failed"][:_FAILED]:
        yield Items(tuple(Item(f"{value_and_limit(item)}.", "Failed", tone="bad") for item in failed))
    reason, command = next_step(result)
    yield Paragraph(reason)
    yield Code(command, "sh")
    if result.scored and summary.truth.known:
        yield at_a_glance(result, total)
    if picture:
        yield picture
    if total > len(summary.trackers):
        listed = f"The first {len(summary.trackers):,} of {total:,} trackers are listed here"
        yield Paragraph(f"{listed}; result.json and the tables in Parquet have all of them.")
    if missing:
        failures = [Item(why_not_ranked(result, tracker), tracker.name, tone="bad") for tracker in missing]
        yield Section("Not ranked", (Items(tuple(failures)),))


def next_step(result: Result) -> tuple[str, str]:
    """Return the most useful next question about a run, and the command that answers the question in its folder."""
    if not result.summary.has_recording or any(x.outcome == "failed" for x in result.summary.expectations):
        inspect = "trackbench inspect . --worst 3"
    else:
        inspect = f"trackbench view .{' --worst' * result.summary.truth.known}"
    return next(iter(questions(result)), (NEXT["inspect"], inspect))


def questions(result: Result) -> Iterator[tuple[str, str]]:
    """Yield questions about a tracker's faults and about other traffic, each with the command that answers it."""
    summary = result.summary
    words = shlex.split(summary.command)
    if words[:2] != ["trackbench", "run"]:
        return
    if (tracker := _worst(result)) and (subject := _argument_of_doctor(tracker, summary, shlex.quote(words[2]))):
        yield NEXT["doctor"].format(name=tracker.name), f"trackbench doctor {subject}"
    if summary.truth.source == "highway-env" and not summary.truth.scenes:
        out = "" if "--out" in words else " --out results/scenes"
        yield NEXT["scenes"], f"{summary.command} --scenes 10{out}"


def _argument_of_doctor(tracker: TrackerResult, summary: Summary, scenario: str) -> str:
    """Return the argument of ``trackbench doctor`` that names a tracker, by scenario file or by class; else ""."""
    changes = [item for item in summary.scenario.overrides if item.startswith(f"trackers.{tracker.name}")]
    if not changes:
        return f"{scenario}#{tracker.name}"
    is_whole = changes[0].startswith(f"trackers.{tracker.name}=") and len(changes) == 1 and "options" not in changes[0]
    # The doctor gives a class the scans of all sensors.
    is_alike = is_whole and tracker.sensors is None and isinstance(tracker.use, str)
    return f"{tracker.use} --scenario {scenario}" if is_alike else ""


def _worst(result: Result) -> TrackerResult | None:
    """Return the tracker with the gravest fault: failed, diverged, worse than a baseline, or inconsistent."""
    pairs, baselines = Pairs(result), [tracker.name for tracker in result.scored if tracker.baseline]
    candidates = [t for t in result.summary.trackers if not (t.baseline or t.is_reference or t.offline)]

    def gravity(tracker: TrackerResult) -> int:
        is_beaten = any((pair := pairs.get(tracker.name, name)) and pair.verdict == "worse" for name in baselines)
        is_wrong = metric_of(tracker, "nees").verdict in ("optimistic", "pessimistic", "mixed", "heavy-tailed")
        return 4 * bool(tracker.failed) or 3 * bool(tracker.health.diverged_runs) or 2 * is_beaten or int(is_wrong)

    ranked = {name: place for place, name in enumerate(result.summary.ranking)}
    worst = max(candidates, key=lambda t: (gravity(t), ranked.get(t.name, 0)), default=None)
    return worst if worst is not None and gravity(worst) else None


#: Number of failed expectations on the first screen.
_FAILED = 3


def at_a_glance(result: Result, total: int) -> Table:
    """Return a small ranking table: error and covariance verdict of trackers, best first; ``total``: all trackers."""
    trackers, path = result.drawn, result.summary.headline
    metrics = [metric_of(tracker, path) for tracker in trackers]
    places = decimals(metric.value for metric in metrics)
    runs = result.summary.runs
    errors = [_barred(metric, places, divergence(t, runs)) for t, metric in zip(trackers, metrics, strict=True)]
    columns = [
        (Column(f"{result.summary.headline_name}, m", "with its 95 % interval", details=INTERVAL), errors),
        (Column("covariance", "what the NEES says, by conditions too", left=True), list(map(_judged, trackers))),
    ]
    caption = f"The best {len(trackers)} of {total:,} trackers" if len(trackers) < len(result.scored) else ""
    return tracker_table("at-a-glance", trackers, columns, caption)


def _barred(metric: MetricValue, places: int, diverged: str) -> Cell:
    value, ci95 = metric.value, metric.ci95
    if value is None:
        return missing_cell(metric)
    # Few runs decide the mean of a tracker that diverged, so its interval says nothing.
    if diverged:
        return Cell(rounded(value, places), (diverged,), "bad", bar=(value, value, value))
    spread = (reach_text(value, ci95, places),) if ci95 else ()
    return Cell(rounded(value, places), spread, bar=(value, *(ci95 or (value, value))))


def _judged(tracker: TrackerResult) -> Cell:
    """Return a cell with a tracker's covariance verdict and where it is off; without a verdict, the mean NEES."""
    nees = metric_of(tracker, "nees")
    if nees.value is None:
        return missing_cell(nees)
    if nees.verdict is None and nees.ci95 is None:
        return Cell(f"NEES {rounded(nees.value, 1)} ({nees.dof or 4} expected)")
    judged = nees if nees.verdict else nees.model_copy(update={"verdict": mean_verdict(nees.ci95, nees.dof or 4)})
    word, sentence = (verdict_in_words(judged, tracker.conditions, whole=whole) for whole in (False, True))
    conditions = "" if word == sentence else sentence.partition("; ")[2] or sentence
    return Cell(word, (conditions,) if conditions else (), tone_of(judged), chip=True)
