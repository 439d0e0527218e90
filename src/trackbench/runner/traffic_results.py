"""The blocks of a run of unlabelled detections to its result."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackbench.base.types import Array
from trackbench.engine.equations import ComputedBy
from trackbench.metrics import Evaluation, Metric, evaluate, merge_sums, no_metrics
from trackbench.metrics.differences import differences
from trackbench.metrics.evaluate import log_broken
from trackbench.metrics.intervals import ratio, variance_shares
from trackbench.metrics.registry import headline
from trackbench.metrics.traffic import TRACK_METRICS, TRACKS, run_sums
from trackbench.results import Failure, Health, MetricValue, Result, Tables, TrackerResult
from trackbench.results.score_summary import MarginSummary
from trackbench.runner import traffic_tables
from trackbench.runner.block import Block, failures_and_outcomes
from trackbench.runner.describe import describe
from trackbench.runner.engines import engine_of_all, engines_of, log_left_to_numpy
from trackbench.runner.expectations import judge
from trackbench.runner.hidden_run import TrafficScores
from trackbench.runner.summary import summarised, summary_of_metric
from trackbench.runner.traffic_sums import TrafficEvaluation
from trackbench.runner.work import Work
from trackbench.scenario import Scenario
from trackbench.truth import LoadedTruth

HEADLINE = headline(TRACK_METRICS.values())
#: Why there is no value where nothing had to be tracked: every number would be as good as perfect.
NOTHING_DUE = "no object was ever due: none came into a sensor's view (fov_deg, max_range_m, mount)"


def assemble_traffic(
    loaded: Scenario, truths: Sequence[LoadedTruth], work: Work, blocks: Sequence[Block], command: str
) -> Result:
    """The result of all blocks of a run."""
    scenario = loaded.config
    failures, outcomes = failures_and_outcomes(work.trackers, blocks)
    found = {name: _evaluation(work, items) for name, items in outcomes.items()}
    known = _known(work)
    ranked = list(found)
    compared = {name: evaluation.metrics.intervals for name, evaluation in found.items()}
    if all(HEADLINE in intervals for intervals in compared.values()):
        ranked.sort(key=lambda name: compared[name][HEADLINE].value)
    compared = {name: compared[name] for name in ranked}
    margin = MarginSummary(**scenario.score.margin.model_dump())
    wanted = {item.metric for item in scenario.expect if item.better_than is not None}
    coverage = dict.fromkeys(ranked, 1.0)
    pairs = differences(compared, work.metrics, margin, coverage, wanted) if known else []
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
        metrics=[summary_of_metric(metric) for metric in work.metrics],
        trackers=trackers,
        ranking=[*ranked, *failures],
        differences=pairs,
        expectations=judge(scenario.expect, trackers, pairs, 0.0),
    )
    log_broken(evaluation.metrics.broken for evaluation in found.values())
    return Result(summary, Tables(traffic_tables.tables(work, blocks, found)))


def _evaluation(work: Work, blocks: Sequence[TrafficScores]) -> TrafficEvaluation:
    known, metrics = _known(work), [metric for metric in work.metrics if _known(work) or metric.without_truth]
    evaluation = Evaluation(merge_sums([block.metrics for block in blocks], metrics))
    if known and not run_sums(evaluation.sums[TRACKS.name], "matched_share")[1].any():
        evaluation.values = no_metrics(NOTHING_DUE, work.metrics)
    else:
        evaluation = evaluate(evaluation.sums, work.scene_of_run, metrics)
        if not known:
            evaluation.values |= no_metrics("there is no truth", _of_truth(work))
    seconds, steps = sum(block.seconds for block in blocks), sum(block.steps for block in blocks)
    evaluation.values["step_time"] = MetricValue(value=1e6 * seconds / max(steps, 1), unit="us")
    reused = int(sum(block.reused_ids.sum() for block in blocks))
    return TrafficEvaluation([block.sums for block in blocks], evaluation, reused)


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
        return TrackerResult(
            name=name,
            describe=described,
            association=method,
            engine=engine,
            failed=failures[name],
            metrics=no_metrics(reason, _of_truth(work)),
            health=Health(),
        )
    evaluation = found[name]
    health = Health(reused_ids=evaluation.reused_ids)
    ranked = HEADLINE in evaluation.metrics.intervals
    shares = variance_shares(ratio(*evaluation.sums(HEADLINE)), work.scene_of_run) if ranked else None
    return TrackerResult(
        name=name,
        describe=described,
        association=method,
        engine=engine,
        failed=None,
        metrics=evaluation.metrics.values,
        health=health,
        scene_share=None if shares is None else shares.scene,
    )


def _of_truth(work: Work) -> list[Metric]:
    """The metrics that need a truth."""
    return [*TRACK_METRICS.values(), *(metric for metric in work.metrics if not metric.without_truth)]


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
