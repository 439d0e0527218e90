"""The blocks of a run of unlabelled detections to its result."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Array
from trackbench.engine.equations import ComputedBy
from trackbench.metrics import merge_sums, no_metrics
from trackbench.metrics.differences import differences
from trackbench.metrics.evaluate import finished, log_broken
from trackbench.metrics.intervals import clustered, ratio, variance_shares
from trackbench.metrics.traffic import TRACK_METRICS
from trackbench.metrics.traffic.without_truth import NO_TRUTH
from trackbench.results import Failure, Health, Result, Tables, TrackerResult
from trackbench.results.score_summary import MarginSummary
from trackbench.runner import traffic_tables
from trackbench.runner.block import Block, failures_and_outcomes
from trackbench.runner.describe import describe
from trackbench.runner.engines import engine_of_all, engines_of, log_left_to_numpy
from trackbench.runner.expectations import judge
from trackbench.runner.hidden_run import TrafficScores
from trackbench.runner.summary import summarised, summary_of_metric
from trackbench.runner.traffic_sums import NOTHING_DUE, TrafficEvaluation, track_metrics
from trackbench.runner.work import Work
from trackbench.scenario import Scenario
from trackbench.truth import LoadedTruth

HEADLINE = "gospa"


def assemble_traffic(
    loaded: Scenario, truths: Sequence[LoadedTruth], work: Work, blocks: Sequence[Block], command: str
) -> Result:
    """The result of all blocks of a run."""
    scenario = loaded.config
    failures, found = _evaluated(work, blocks)
    known = _known(work)
    ranked = list(found)
    if all(HEADLINE in evaluation.intervals for evaluation in found.values()):
        ranked.sort(key=lambda name: found[name].intervals[HEADLINE].value)
    margin = MarginSummary(**scenario.score.margin.model_dump())
    compared = {
        name: {
            **found[name].intervals,
            **{path: clustered(own, work.scene_of_run) for path, own in found[name].own_intervals.items()},
        }
        for name in ranked
    }
    wanted = {item.metric for item in scenario.expect if item.better_than is not None}
    metrics = [*track_metrics(known).values(), *work.metrics]
    pairs = differences(compared, metrics, margin, dict.fromkeys(ranked, 1.0), wanted, ranks=HEADLINE) if known else []
    engines = engines_of(work, blocks)
    for name, used in engines.items():
        log_left_to_numpy(work.scenario, name, used)
    trackers = [
        _tracker(work, name, failures, found, engines[name].engine if name in engines else None)
        for name in work.trackers
    ]
    summary = summarised(
        loaded,
        truths,
        work,
        blocks,
        command,
        errors=_by_scene(work, found),
        detected={
            sensor.name: sum(block.detections.get(sensor.name, 0.0) for block in blocks)
            for sensor in work.scenes[0].sensors
        },
        reference=None,
        engine=engine_of_all(work, engines),
        common_share=None,
        metrics=[summary_of_metric(metric) for metric in metrics],
        trackers=trackers,
        ranking=[*ranked, *failures],
        differences=pairs,
        expectations=judge(scenario.expect, trackers, pairs, 0.0),
    )
    log_broken(evaluation.broken for evaluation in found.values())
    return Result(summary, Tables(traffic_tables.tables(work, blocks, found)))


def _evaluated(work: Work, blocks: Sequence[Block]) -> tuple[dict[str, Failure], dict[str, TrafficEvaluation]]:
    failures, outcomes = failures_and_outcomes(work.trackers, blocks)
    return failures, {name: _evaluation(work, items) for name, items in outcomes.items()}


def _evaluation(work: Work, blocks: Sequence[TrafficScores]) -> TrafficEvaluation:
    seconds, steps = sum(block.seconds for block in blocks), sum(block.steps for block in blocks)
    reused = int(sum(block.reused_ids.sum() for block in blocks))
    known = _known(work)
    found = TrafficEvaluation([block.sums for block in blocks], {}, reused, 1e6 * seconds / max(steps, 1), known)
    for path, metric in track_metrics(known).items() if not found.nothing_due else ():
        interval = metric.finish(found.sums(path))
        if interval is not None:
            found.intervals[path] = clustered(interval, work.scene_of_run)
    if not known or found.nothing_due:
        found.own = no_metrics(NOTHING_DUE if known else NO_TRUTH, work.metrics)
        return found
    sums = merge_sums([block.metrics for block in blocks], work.metrics)
    for own in work.metrics:
        values, broken = finished(own, sums[own.accumulator.name], (), len(work.scene_of_run))
        if broken:
            found.broken[own.name] = broken
        for path, (value, influence) in values.items():
            found.own[path] = value
            if influence is not None:
                found.own_intervals[path] = influence
                found.own[path] = clustered(influence, work.scene_of_run).as_value(own.unit)
    return found


def _tracker(
    work: Work,
    name: str,
    failures: dict[str, Failure],
    found: dict[str, TrafficEvaluation],
    engine: ComputedBy | None,
) -> TrackerResult:
    config = work.trackers[name]
    described, associate = describe(config, work.late_sensors), getattr(config, "associate", None)
    method = None if associate is None else associate.method
    if name in failures:
        reason = "the tracker failed"
        metrics = {path: metric.no_value(reason) for path, metric in TRACK_METRICS.items()}
        metrics |= no_metrics(reason, work.metrics)
        return TrackerResult(
            name=name,
            describe=described,
            association=method,
            engine=engine,
            failed=failures[name],
            metrics=metrics,
            health=Health(),
        )
    evaluation = found[name]
    health = Health(reused_ids=evaluation.reused_ids)
    ranked = HEADLINE in evaluation.intervals
    shares = variance_shares(ratio(*evaluation.sums(HEADLINE)), work.scene_of_run) if ranked else None
    return TrackerResult(
        name=name,
        describe=described,
        association=method,
        engine=engine,
        failed=None,
        metrics=evaluation.values,
        health=health,
        scene_share=None if shares is None else shares.scene,
    )


def _known(work: Work) -> bool:
    """Whether there is a truth."""
    return all(scene.truth.known for scene in work.scenes)


def _by_scene(work: Work, found: dict[str, TrafficEvaluation]) -> dict[str, Array]:
    """By tracker ``(scenes,)`` the headline in each scene."""
    by_scene = {}
    for name, evaluation in found.items():
        sums = [np.bincount(work.scene_of_run, each) for each in evaluation.sums(HEADLINE)]
        by_scene[name] = np.sqrt(sums[0] / np.where(sums[1] > 0, sums[1], np.nan))
    return by_scene
