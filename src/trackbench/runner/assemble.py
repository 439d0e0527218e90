"""The blocks of a run to its result."""

from __future__ import annotations

from collections.abc import Sequence

import pyarrow as pa

from trackbench.metrics import health, no_metrics
from trackbench.metrics.breakdown import breakdown
from trackbench.metrics.differences import differences
from trackbench.metrics.evaluate import log_broken
from trackbench.results import Health, Result, Tables, TrackerResult
from trackbench.results.scenario_summary import ReferenceSummary
from trackbench.results.score_summary import MarginSummary
from trackbench.runner import recorded_tables, tables
from trackbench.runner.block import Block
from trackbench.runner.describe import describe
from trackbench.runner.engines import engine_of_all, engines_of, log_left_to_numpy
from trackbench.runner.evaluated import evaluated
from trackbench.runner.expectations import judge
from trackbench.runner.mode_tables import mode_tables
from trackbench.runner.summary import summarised, summary_of_metric
from trackbench.runner.work import Work
from trackbench.scenario import Scenario
from trackbench.trackers.answers import NOT_FINITE
from trackbench.trackers.config import FilterConfig
from trackbench.truth import LoadedTruth


def assemble(
    loaded: Scenario, truths: Sequence[LoadedTruth], work: Work, blocks: Sequence[Block], command: str
) -> Result:
    """The result of all blocks of a run."""
    scenario = loaded.config
    assembly = _Assembly(work, blocks)
    found = assembly.found
    compared = {name: found.evaluations[name].intervals for name in work.trackers if name in found.ranked}
    margin = MarginSummary(**scenario.score.margin.model_dump())
    coverage = {name: found.scores[name].coverage for name in found.ranked}
    wanted = {item.metric for item in scenario.expect if item.better_than is not None}
    pairs = differences(compared, work.metrics, margin, coverage, wanted)
    trackers = [assembly.tracker(name) for name in work.trackers]
    summary = summarised(
        loaded,
        truths,
        work,
        blocks,
        command,
        errors={name: found.error_by_scene(name) for name in found.ranked},
        detected={
            sensor.name: sum(block.detections[sensor.name] for block in blocks) for sensor in work.scenes[0].sensors
        },
        reference=ReferenceSummary(
            kind="bound" if work.acceleration_as_drawn else "reference",
            motion="cv",
            acceleration_sigma_mps2=work.acceleration,
            acceleration_from="truth" if scenario.score.reference.acceleration_sigma_mps2 is None else "scenario",
            acceleration_changes="each truth step" if work.acceleration_as_drawn else "each measurement",
            velocity_sigma_mps=work.velocity_sigma,
        ),
        engine=engine_of_all(work, assembly.engines),
        common_share=found.common_share,
        metrics=[summary_of_metric(metric) for metric in scenario.score.metrics],
        trackers=trackers,
        ranking=[*found.ranked, *(name for name in work.trackers if name not in found.ranked)],
        differences=pairs,
        expectations=judge(scenario.expect, trackers, pairs, work.min_coverage),
    )
    for name, used in assembly.engines.items():
        log_left_to_numpy(work.scenario, name, used)
    log_broken(evaluation.broken for evaluation in found.evaluations.values())
    return Result(summary, Tables(assembly.tables()))


class _Assembly:
    """What the blocks of a run amount to."""

    def __init__(self, work: Work, blocks: Sequence[Block]) -> None:
        self._work = work
        self._blocks = blocks
        self.found = evaluated(work, blocks)
        self.engines = engines_of(work, blocks)

    def tracker(self, name: str) -> TrackerResult:
        """The entry of one tracker."""
        failure = self.found.failures.get(name)
        config = self._work.trackers[name]
        described, smoother = (
            describe(config, self._work.late_sensors),
            config.smoother if isinstance(config, FilterConfig) else None,
        )
        engine = self.engines[name].engine if name in self.engines else None
        if failure is not None:
            return TrackerResult(
                name=name,
                describe=described,
                smoother=smoother,
                engine=engine,
                failed=failure,
                metrics=no_metrics("the tracker failed", self._work.metrics),
                health=Health(non_finite_estimates=int(failure.cause == NOT_FINITE)),
            )
        evaluation = self.found.evaluations[name]
        return TrackerResult(
            name=name,
            describe=described,
            smoother=smoother,
            engine=engine,
            failed=None,
            metrics=evaluation.values,
            health=health(self.found.scores[name]),
            breakdown=breakdown(evaluation.scores.classes),
            scene_share=self.found.scene_share(name),
        )

    def tables(self) -> dict[str, pa.Table]:
        """Every table by name."""
        work, run = self._work, self._work.recorded_run
        scene = work.scenes[work.recorded_scene]
        truth, instants = scene.truth, scene.instants()
        block = next(block for block in self._blocks if block.recorded_scans is not None)
        assert block.recorded_scans is not None
        longest = max(work.scenes, key=lambda item: len(item.instants()))
        times = {sensor.name: sensor.time for sensor in longest.sensors}
        own = {sensor.name: sensor.time for sensor in scene.sensors}
        evaluations = self.found.evaluations
        recorded = {name: estimates for name, estimates in block.recorded.items() if name in evaluations}
        return {
            "steps": tables.steps_table(evaluations, longest.truth.time[longest.instants()]),
            "nis": tables.nis_table(self.found.scores, times),
            "runs": tables.runs_table(self.found, work.scene_of_run),
            "breakdown": tables.breakdown_table(evaluations),
            "autocorrelation": tables.autocorrelation_table(self.found.scores),
            "truth": recorded_tables.truth_table(truth, run),
            "measurements": recorded_tables.measurements_table(block.recorded_scans.scans, truth.ids),
            "estimates": recorded_tables.estimates_table(recorded, truth, instants, run),
            "recorded_nis": recorded_tables.recorded_nis_table(recorded, truth.ids, own),
            "roads": recorded_tables.roads_table(truth),
            **mode_tables(
                {name: work.trackers[name] for name in evaluations},
                self._blocks,
                longest.truth.time[longest.instants()],
                truth.time[instants],
                truth.ids,
            ),
        }
