"""The first screen of a run's report: the answer, the expectations, a small ranking, and the scene from above."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence

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
    Row,
    Section,
    Status,
    Table,
    Tone,
    TrackerStyle,
)
from trackbench.metrics.covariance_words import verdict_in_words
from trackbench.metrics.recorded_run import EstimateMoment
from trackbench.metrics.verdicts import mean_verdict
from trackbench.report import tables
from trackbench.report.figures.map import map_of_scene
from trackbench.report.moments import diverged_elsewhere, moment_text
from trackbench.report.numbers import decimals, reach_text, rounded
from trackbench.report.pairs import Pairs
from trackbench.report.replay import replay_of_run
from trackbench.report.sentences import answer_of_run, divergence, expectations_met, listed_of, value_and_limit
from trackbench.report.tables import INTERVAL, metric_of, missing_cell, tone_of, tracker_table
from trackbench.report.verdicts import NEXT
from trackbench.results import MetricValue, Result, TrackerResult


def picture(result: Result, shown: Sequence[TrackerStyle], moments: Mapping[str, EstimateMoment]) -> Figure | None:
    """The recorded run from above; None without a truth, a true path or, with hidden identities, a tracker."""
    names = shown_first(result, shown)
    summary = result.summary
    if not summary.truth.known or (summary.identities == "hidden" and not names):
        return None
    scene = replay_of_run(result, shown, names, moments)
    errors = "; ".join(moment_text(moments[name]) for name in names if name in moments)
    caption = f"Run {summary.recorded_run}.{f' Largest errors: {errors}.' * bool(errors)} {diverged_elsewhere(result)}"
    return map_of_scene(scene, caption.rstrip()) if scene else None


def shown_first(result: Result, shown: Sequence[TrackerStyle]) -> list[str]:
    """The best and the last of the drawn trackers that filter: no baseline and no reference."""
    filtering = {tracker.name for tracker in result.filtering}
    names = [style.name for style in shown if style.name in filtering]
    return list(dict.fromkeys([names[0], names[-1]])) if names else []


def first_screen(result: Result, trackers: int, picture: Figure | None) -> Iterator[Block]:
    """The first sentence, the expectations, who is how good, and who is not ranked, of so many ``trackers``."""
    summary, missing = result.summary, result.unscored
    answer = answer_of_run(result)
    # A tracker's name keeps its letters.
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
    glance: list[Block] = [at_a_glance(result, trackers)] if result.scored and summary.truth.known else []
    if beside := (*glance, *([picture] if picture else [])):
        yield Row(beside)
    if trackers > len(summary.trackers):
        yield Paragraph(listed_of(summary, trackers))
    if missing:
        failures = tuple(Item(result.why_unscored(tracker), tracker.name, tone="bad") for tracker in missing)
        numbers = tables.unranked_table(result)
        yield Section("Not ranked", (Items(failures), *([numbers] if numbers else [])))


def next_step(result: Result) -> tuple[str, str]:
    """Return what to do next, and the command for it; ``.`` is the folder of the run."""
    if not result.summary.has_recording or any(x.outcome == "failed" for x in result.summary.expectations):
        inspect = "trackbench inspect . --worst 3"
    else:
        inspect = f"trackbench view .{' --worst' * result.summary.truth.known}"
    return next(iter(questions(result)), (NEXT["inspect"], inspect))


def questions(result: Result) -> Iterator[tuple[str, str]]:
    """Yield what to ask next of a run of a scenario's file, each with its command: what is wrong with a tracker, and
    what holds in other traffic."""
    summary = result.summary
    words = shlex.split(summary.command)
    if words[:2] != ["trackbench", "run"]:
        return
    # The doctor takes a tracker as the scenario's file has it.
    if (name := _worst(result)) and not any(word.startswith(f"trackers.{name}") for word in words):
        yield NEXT["doctor"].format(name=name), f"trackbench doctor {shlex.quote(words[2])}#{name}"
    if summary.truth.source == "highway-env" and not summary.truth.scenes:
        kept_apart = "" if "--out" in words else " --out results/scenes"
        yield NEXT["scenes"], f"{summary.command} --scenes 10{kept_apart}"


def _worst(result: Result) -> str:
    """The tracker with the most wrong: failed, diverged, worse than a baseline, or a covariance that is off; or ""."""
    pairs, baselines = Pairs(result), [tracker.name for tracker in result.scored if tracker.baseline]
    own = [t for t in result.summary.trackers if not (t.baseline or t.is_reference or t.offline)]

    def wrong(tracker: TrackerResult) -> int:
        beaten = any((pair := pairs.get(tracker.name, name)) and pair.verdict == "worse" for name in baselines)
        off = metric_of(tracker, "nees").verdict in ("optimistic", "pessimistic", "mixed", "heavy-tailed")
        return 4 * bool(tracker.failed) or 3 * bool(tracker.health.diverged_runs) or 2 * beaten or int(off)

    ranked = {name: place for place, name in enumerate(result.summary.ranking)}
    worst = max(own, key=lambda t: (wrong(t), ranked.get(t.name, 0)), default=None)
    return worst.name if worst is not None and wrong(worst) else ""


#: Failed expectations on the first screen.
_FAILED = 3


def at_a_glance(result: Result, every: int) -> Table:
    """The drawn trackers, best first: the metric that ranks, with a bar, and the word of the covariance's verdict; last
    those without a rank. ``every``: the number of all trackers."""
    trackers, path, unscored = result.drawn, result.summary.headline, result.unscored
    metrics = [metric_of(tracker, path) for tracker in trackers]
    places = decimals(metric.value for metric in metrics)
    failed = [Cell("failed" if tracker.failed else "not ranked", tone="bad", chip=True) for tracker in unscored]
    runs = result.summary.runs
    cells = [_barred(metric, places, divergence(t, runs)) for t, metric in zip(trackers, metrics, strict=True)]
    barred = [*cells, *(Cell("") for _ in unscored)]
    columns = [
        (Column(f"{result.summary.headline_name}, m", "with its 95 % interval", details=INTERVAL), barred),
        (Column("covariance", "what the NEES says, by conditions too", left=True), [*map(_judged, trackers), *failed]),
    ]
    caption = f"The best {len(trackers)} of {every:,} trackers" if len(trackers) < len(result.scored) else ""
    return tracker_table("at-a-glance", [*trackers, *unscored], columns, caption)


def _barred(metric: MetricValue, places: int, diverged: str) -> Cell:
    """Of what diverged that alone: the interval of a mean that few runs decide says nothing."""
    value, ci95 = metric.value, metric.ci95
    if value is None:
        return missing_cell(metric)
    if diverged:
        return Cell(rounded(value, places), (diverged,), "bad", bar=(value, value, value))
    spread = (reach_text(value, ci95, places),) if ci95 else ()
    return Cell(rounded(value, places), spread, bar=(value, *(ci95 or (value, value))))


def _judged(tracker: TrackerResult) -> Cell:
    """What the NEES says of a covariance; of tracks that have no verdict their mean NEES."""
    nees = metric_of(tracker, "nees")
    if nees.value is None:
        return missing_cell(nees)
    if nees.verdict is None and nees.ci95 is None:
        return Cell(f"NEES {rounded(nees.value, 1)} ({nees.dof or 4} expected)")
    judged = nees if nees.verdict else nees.model_copy(update={"verdict": mean_verdict(nees.ci95, nees.dof or 4)})
    word, whole = (verdict_in_words(judged, tracker.conditions, whole=whole) for whole in (False, True))
    where = "" if word == whole else whole.partition("; ")[2] or whole
    return Cell(word, (where,) if where else (), tone_of(judged), chip=True)
