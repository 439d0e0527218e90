"""The report of a run: one page, whose sections depend on its identities, its truth and its metrics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from trackbench.base.subjects import collected
from trackbench.document import Block, Code, Document, Figure, Item, Items, Paragraph, Row, Section, Table, TrackerStyle
from trackbench.document.palette import tracker_styles
from trackbench.metrics.intervals import FEWEST_SCENES, TOO_FEW_SCENES, UNCALIBRATED
from trackbench.report import tables
from trackbench.report.conditions import condition_tables, consistency_table
from trackbench.report.figures.over_time import errors_over_time, gospa_over_time
from trackbench.report.first_screen import first_screen, picture
from trackbench.report.moments import causes_table
from trackbench.report.numbers import margin_words
from trackbench.report.pairs import Pairs, standing
from trackbench.report.scenes import (
    ONE_RUN,
    basis_of_intervals,
    scene_blocks,
    undrawn_scenes,
    values_of_few_scenes,
)
from trackbench.report.sentences import facts, provenance, remarks
from trackbench.report.truth_and_sensors import audit_table, sensor_table, truth_verdict
from trackbench.report.verdicts import CERTAINTY, REMARKS
from trackbench.results import Result


def result_document(result: Result) -> Document:
    """Return the report of a run: answer, ranking, errors by condition, over time and scene, truth and sensors."""
    trackers, result, summary = len(result.summary.trackers), result.listed, result.listed.summary
    styles = tracker_styles(result.places)
    shown = [styles[tracker.name] for tracker in result.drawn]
    blocks = [
        Section("Verdict", tuple(first_screen(result, trackers, picture(result)))),
        *_sections(result, shown),
        *([] if summary.passed else [Section("Expectations", (tables.expectation_table(result),))]),
        _truth_and_sensors(result),
        Section("How to reproduce it", tuple(_reproduction(result)), True),
    ]
    name, description = summary.scenario.name, summary.scenario.description
    return Document("report", name, tuple(blocks), description, facts(result, trackers), tuple(shown))


def _sections(result: Result, shown: Sequence[TrackerStyle]) -> Iterator[Section]:
    """Yield the sections of the report between its first screen and the expectations."""
    summary, scored = result.summary, result.scored
    if not summary.truth.known:
        for title, (note, paths) in _WITHOUT_TRUTH.items():
            yield Section(title, (Paragraph(note), tables.track_table(title, scored, paths)))
        return
    other_metrics = tables.other_metrics(result)
    if scored:
        yield _ranking(result)
    if summary.truth.scenes:
        yield Section("Scene by scene", tuple(scene_blocks(result)))
    yield from collected("sections", result, shown)
    if summary.identities == "known":
        yield from _section("Over time", errors_over_time(result, shown))
        yield from _section("By manoeuvre and range", *condition_tables(result), folded=True)
        yield Section("Consistency", (consistency_table(result),), folded=True)
    else:
        yield from _section("Over time", gospa_over_time(result, shown))
        yield from _section("What costs most in all runs", causes_table(result))
        for title, paths in tables.TRACK_GROUPS.items() if scored else ():
            caption = ""
            if title == tables.MATCHED:
                caption = REMARKS["matched"].format(reach=(summary.score.cutoff_m or 0.0) / 2)
            yield Section(title, (tables.track_table(title, scored, paths, caption=caption),), folded=True)
    if other_metrics is not None:
        yield Section("Other metrics", (other_metrics,))


#: Sections of a run without a truth: a note and the metrics of the table, by title.
_WITHOUT_TRUTH: dict[str, tuple[str, tuple[str, ...]]] = {
    "Tracks": (
        "More or longer tracks are not better: they may be on no object.",
        ("track_count", "new_tracks", "used_share"),
    ),
    "Predictions": (
        "How well each tracker predicts all detections of the next scan, false alarms too; not how near tracks are to "
        "vehicles. NIS is of the detections that the tracker then used.",
        ("nis", "prediction_score"),
    ),
}


def _ranking(result: Result) -> Section:
    """Return the section with the ranking of the scored trackers, the basis of its intervals, and remarks."""
    summary, column, pairs = result.summary, standing(result), Pairs(result)
    basis = f"Small print: 95 % interval, {basis_of_intervals(result)}."
    if values_of_few_scenes(result):
        basis = f"No valid interval, and no verdict, with fewer than {FEWEST_SCENES} scenes: see “Scene by scene”."
        basis = basis if summary.truth.scenes else f"{ONE_RUN}."
    note, listed = f"“{column.heading}”: {column.meaning}. {basis}", remarks(result)
    if len(result.scored) > 1:
        which = "all pairs" if summary.score.baseline is None else f"all trackers against {summary.score.baseline}"
        kind = CERTAINTY["all pairs" if summary.score.best is None else "best of many"]
        note += " " + kind.format(margin=margin_words(pairs.margins), pairs=which, best=summary.score.best)
        listed += undrawn_scenes(len(summary.truth.scenes), summary.truth.few_scenes_decide)
    reasons = {tables.metric_of(tracker, summary.headline).reason or "" for tracker in result.scored}
    listed += sorted(text for text in reasons - {TOO_FEW_SCENES} if text.startswith(UNCALIBRATED))
    items = [Items(tuple(Item(f"{remark}.") for remark in listed))] if listed else []
    return Section("Ranking", (Paragraph(note), tables.ranking_table(result), *items))


def _section(title: str, *blocks: Figure | Table | None, folded: bool = False) -> Iterator[Section]:
    """Yield a section with the blocks that are not None, side by side; yield nothing if all are None."""
    if present := tuple(block for block in blocks if block):
        yield Section(title, (Row(present),), folded)


def _truth_and_sensors(result: Result) -> Section:
    truth = result.summary.truth
    if not truth.known:
        return Section("Sensors", (sensor_table(result),))
    audit = audit_table(truth)
    tables_shown = (audit, sensor_table(result)) if audit else (sensor_table(result),)
    return Section("Truth and sensors", (Paragraph(truth_verdict(truth)), *tables_shown), folded=True)


def _reproduction(result: Result) -> Iterator[Block]:
    summary, scenario = result.summary, result.summary.scenario
    if summary.command:
        yield Code(summary.command, "sh")
    changed = f", changed by the command: {', '.join(scenario.overrides)}" if scenario.overrides else ""
    items = [
        Item(summary.fingerprint, "fingerprint of all measurements"),
        Item(summary.made_with, "made with"),
        Item(f"scenario.text in result.json{changed}", f"text of {scenario.file}"),
    ]
    yield Items(tuple(items))
    if origins := provenance(result):
        yield Section("Provenance", (Items(tuple(Item(text, label) for label, text in origins)),))
