"""The blocks of a run to its result."""

from __future__ import annotations

import logging
import platform
from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import version

import numpy as np
import pyarrow as pa

from trackbench.metrics import Evaluation, Metric, Scores, Sums, evaluate, health, merge_sums, no_metrics
from trackbench.metrics.bound import BoundStart, cramer_rao, rms_bound, typical_acceleration
from trackbench.metrics.breakdown import breakdown
from trackbench.metrics.differences import differences
from trackbench.metrics.estimates import ESTIMATES
from trackbench.results import Failure, Health, Result, Summary, Tables, TrackerResult
from trackbench.results.summary import (
    BoundSummary,
    OwnMetricSummary,
    ScenarioSummary,
    ScoreSummary,
    SensorSummary,
    TruthSummary,
)
from trackbench.runner import recorded_tables, tables
from trackbench.runner.block import Block, Work
from trackbench.runner.describe import describe
from trackbench.runner.expectations import judge
from trackbench.scenario import Scenario
from trackbench.scenario.config import BoundConfig
from trackbench.sensing.scans import scan_rate
from trackbench.trackers.answers import NOT_FINITE
from trackbench.trackers.config import FilterConfig, PluginConfig
from trackbench.truth import LoadedTruth
from trackbench.types import Array

log = logging.getLogger(__name__)

PACKAGES = ("trackbench", "highway-env", "gymnasium", "numpy", "scipy", "rerun-sdk")


def assemble(loaded: Scenario, truth: LoadedTruth, work: Work, blocks: list[Block], command: str) -> Result:
    """The result of all blocks of a run."""
    scenario = loaded.config
    assembly = _Assembly(work, blocks, scenario.score.bound)
    evaluations = assembly.evaluations
    found = differences({name: item.intervals for name, item in evaluations.items()}, work.metrics)
    trackers = [assembly.tracker(name) for name in work.trackers]
    expectations = judge(scenario.expect, trackers, found)
    summary = Summary(
        scenario=ScenarioSummary(
            name=scenario.name,
            description=scenario.description,
            file=loaded.path.name,
            text=loaded.text,
            overrides=list(loaded.overrides),
        ),
        seed=work.seed,
        runs=work.runs,
        versions={"python": platform.python_version(), **{name: version(name) for name in PACKAGES}},
        command=command,
        fingerprints=[digest.hex()[:16] for block in blocks for digest in block.digests],
        truth=_truth_summary(truth),
        sensors=assembly.sensors(),
        bound=BoundSummary(
            motion="cv",
            acceleration_sigma_mps2=assembly.acceleration,
            velocity_sigma_mps=scenario.score.bound.velocity_sigma_mps,
        ),
        score=ScoreSummary(
            settle_s=work.settle,
            divergence_m=work.divergence,
            from_s=float(truth.truth.time[work.instants()[0]]),
            to_s=float(truth.truth.time[work.instants()[-1]]),
            metrics=[_metric_summary(metric) for metric in scenario.score.metrics],
        ),
        recorded_run=work.recorded_run,
        trackers=trackers,
        ranking=_ranking(list(work.trackers), evaluations),
        differences=found,
        expectations=expectations,
        passed=all(item.passed for item in expectations),
        artifacts={},
    )
    _log_broken(evaluations)
    return Result(summary, Tables(assembly.tables()))


class _Assembly:
    """What the blocks of a run amount to."""

    def __init__(self, work: Work, blocks: list[Block], bound: BoundConfig) -> None:
        self._work = work
        self._blocks = blocks
        self._bound = bound
        self._failures: dict[str, Failure] = {}
        self._sums: dict[str, Sums] = {}
        for name in work.trackers:
            outcomes = [block.sums[name] for block in blocks]
            failure = next((outcome for outcome in outcomes if isinstance(outcome, Failure)), None)
            if failure is None:
                whole = [outcome for outcome in outcomes if not isinstance(outcome, Failure)]
                self._sums[name] = merge_sums(whole, work.metrics)
            else:
                self._failures[name] = failure
        self._rates = {
            sensor.name: np.sum([block.detections[sensor.name] for block in blocks], axis=0) / work.runs
            for sensor in work.sensors
        }
        stated = bound.acceleration_sigma_mps2
        self.acceleration = typical_acceleration(work.truth) if stated is None else stated
        self._bounds = self._variances()
        self._scores: dict[str, Scores] = {}
        for name, sums in self._sums.items():
            scores = sums[ESTIMATES.name]
            self._scores[name] = replace(scores, bound=rms_bound(self._bounds[name], scores.weight))
        self.evaluations = {
            name: evaluate({**sums, ESTIMATES.name: self._scores[name]}, work.metrics)
            for name, sums in self._sums.items()
        }

    def tracker(self, name: str) -> TrackerResult:
        """The entry of one tracker."""
        failure = self._failures.get(name)
        described = describe(self._work.trackers[name])
        if failure is not None:
            return TrackerResult(
                name=name,
                describe=described,
                failed=failure,
                metrics=no_metrics("the tracker failed", self._work.metrics),
                health=Health(non_finite_estimates=int(failure.cause == NOT_FINITE)),
            )
        scores = self._scores[name]
        return TrackerResult(
            name=name,
            describe=described,
            failed=None,
            metrics=self.evaluations[name].values,
            health=health(scores),
            breakdown=breakdown(scores.classes),
        )

    def sensors(self) -> dict[str, SensorSummary]:
        """The sensors by name, with their share of detections."""
        found = {}
        for sensor in self._work.sensors:
            rates = self._rates[sensor.name]
            seen = np.broadcast_to(sensor.visible.mean(axis=-1), rates.shape).sum()
            found[sensor.name] = SensorSummary(
                kind=sensor.config.type,
                dof=len(sensor.noise_covariance),
                rate_hz=scan_rate(sensor),
                preset=sensor.config.preset,
                detection_rate=float(rates.sum() / seen) if seen > 0 else None,
            )
        return found

    def tables(self) -> dict[str, pa.Table]:
        """Every table by name."""
        work, truth, instants, run = self._work, self._work.truth, self._work.instants(), self._work.recorded_run
        block = next(block for block in self._blocks if block.scans is not None)
        assert block.scans is not None
        times = {sensor.name: sensor.time for sensor in work.sensors}
        recorded = {name: estimates for name, estimates in block.recorded.items() if name in self._scores}
        return {
            "steps": tables.steps_table(self._scores, self._bounds, truth.time[instants]),
            "nis": tables.nis_table(self._scores, times),
            "runs": tables.runs_table(self._scores, self.evaluations),
            "breakdown": tables.breakdown_table(self._scores),
            "autocorrelation": tables.autocorrelation_table(self._scores),
            "truth": recorded_tables.truth_table(truth, run),
            "measurements": recorded_tables.measurements_table(block.scans, truth.ids),
            "estimates": recorded_tables.estimates_table(recorded, truth, instants, run),
            "recorded_nis": recorded_tables.recorded_nis_table(recorded, work, times),
            "roads": recorded_tables.roads_table(truth),
        }

    def _variances(self) -> dict[str, Array]:
        """Variances of the bound by tracker, computed once for all that read the same sensors from the same start."""
        work = self._work
        known: dict[tuple[tuple[str, ...], BoundStart], Array] = {}
        found = {}
        for name in self._sums:
            tracker = work.trackers[name]
            sensors = [item for item in work.sensors if tracker.sensors is None or item.name in tracker.sensors]
            start = _start(tracker, self._bound)
            case = tuple(sensor.name for sensor in sensors), start
            if case not in known:
                instants = work.instants()
                known[case] = cramer_rao(work.truth, sensors, self._rates, self.acceleration, start, instants)
            found[name] = known[case]
        return found


def _truth_summary(loaded: LoadedTruth) -> TruthSummary:
    truth = loaded.truth
    found = {
        "objects": list(truth.ids),
        "steps": len(truth.time),
        "dt": float(truth.time[1] - truth.time[0]) if len(truth.time) > 1 else None,
        "duration_s": float(truth.time[-1]),
        "audit": truth.audit,
        "cached": loaded.cached,
    }
    return TruthSummary.model_validate({**truth.source, **found})


def _metric_summary(metric: Metric) -> OwnMetricSummary:
    return OwnMetricSummary(
        name=metric.name,
        unit=metric.unit,
        meaning=metric.meaning,
        better=metric.better,
        compared=metric.compared and metric.better is not None,
        per_sensor=metric.per_sensor,
        options=metric.model_dump(mode="json", fallback=str),
    )


def _start(tracker: FilterConfig | PluginConfig, config: BoundConfig) -> BoundStart:
    if isinstance(tracker, FilterConfig) and tracker.initial.source == "truth":
        return BoundStart(tracker.initial.velocity_sigma_mps, tracker.initial.position_sigma_m)
    return BoundStart(config.velocity_sigma_mps)


def _ranking(trackers: list[str], evaluations: Mapping[str, Evaluation]) -> list[str]:
    """By position error, the failed ones last."""
    errors = {name: item.intervals.get("position_rmse") for name, item in evaluations.items()}
    known = {name: error.value for name, error in errors.items() if error is not None}
    ranked = sorted(known, key=known.__getitem__)
    return ranked + [name for name in trackers if name not in ranked]


def _log_broken(evaluations: Mapping[str, Evaluation]) -> None:
    """Say once of each metric that it raised."""
    broken = {metric: cause for item in evaluations.values() for metric, cause in item.broken.items()}
    for metric, cause in broken.items():
        log.warning("metric %s has no value: %s", metric, cause)
