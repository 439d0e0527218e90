"""The blocks of a run to its result."""

from __future__ import annotations

import logging
import math
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version

import numpy as np
import pyarrow as pa

from trackbench.metrics import Evaluation, Metric, health, no_metrics
from trackbench.metrics.breakdown import breakdown
from trackbench.metrics.differences import differences
from trackbench.models.sensors import Sensor
from trackbench.results import Health, Result, Summary, Tables, TrackerResult
from trackbench.results.summary import (
    ComponentNoise,
    MarginSummary,
    MountSummary,
    OwnMetricSummary,
    ReferenceSummary,
    ScenarioSummary,
    SceneSummary,
    ScoreSummary,
    SensorSummary,
    TruthSummary,
)
from trackbench.runner import recorded_tables, tables
from trackbench.runner.block import Block
from trackbench.runner.describe import describe
from trackbench.runner.evaluated import evaluated
from trackbench.runner.expectations import judge
from trackbench.runner.work import Work
from trackbench.scenario import Scenario
from trackbench.sensing.scans import IdealSensor, scan_rate
from trackbench.trackers.answers import NOT_FINITE
from trackbench.truth import LoadedTruth, TruthSource
from trackbench.types import Array

log = logging.getLogger(__name__)

PACKAGES = ("trackbench", "highway-env", "gymnasium", "numpy", "scipy", "rerun-sdk")


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
    instants = [scene.truth.time[scene.instants()] for scene in work.scenes]
    expectations = judge(scenario.expect, trackers, pairs, work.min_coverage)
    summary = Summary(
        scenario=ScenarioSummary(
            name=scenario.name,
            description=scenario.description,
            file=loaded.path.name,
            text=loaded.text,
            overrides=list(loaded.overrides),
        ),
        seed=work.seed,
        runs=work.runs * len(work.scenes),
        versions={"python": platform.python_version(), **{name: version(name) for name in PACKAGES}},
        command=command,
        fingerprints=[digest.hex()[:16] for block in blocks for digest in block.digests],
        truth=truth_summary(
            truths, work, scenario.truth.scenes(), {name: found.error_by_scene(name) for name in found.ranked}
        ),
        sensors=assembly.sensors(),
        reference=ReferenceSummary(
            kind="bound" if work.acceleration_as_drawn else "reference",
            motion="cv",
            acceleration_sigma_mps2=work.acceleration,
            acceleration_from="truth" if scenario.score.reference.acceleration_sigma_mps2 is None else "scenario",
            acceleration_changes="each truth step" if work.acceleration_as_drawn else "each measurement",
            velocity_sigma_mps=work.velocity_sigma,
        ),
        score=ScoreSummary(
            settle_s=work.settle,
            divergence_m=work.divergence,
            lost_after_s=work.lost_after,
            min_coverage=work.min_coverage,
            common_share=found.common_share,
            from_s=min(float(time[0]) for time in instants),
            to_s=max(float(time[-1]) for time in instants),
            margin=margin,
            metrics=[_metric_summary(metric) for metric in scenario.score.metrics],
        ),
        recorded_run=work.number(work.recorded_scene, work.recorded_run),
        trackers=trackers,
        ranking=[*found.ranked, *(name for name in work.trackers if name not in found.ranked)],
        differences=pairs,
        expectations=expectations,
        passed=all(item.passed for item in expectations),
        artifacts={},
    )
    _log_broken(found.evaluations)
    return Result(summary, Tables(assembly.tables()))


class _Assembly:
    """What the blocks of a run amount to."""

    def __init__(self, work: Work, blocks: Sequence[Block]) -> None:
        self._work = work
        self._blocks = blocks
        self.found = evaluated(work, blocks)

    def tracker(self, name: str) -> TrackerResult:
        """The entry of one tracker."""
        failure = self.found.failures.get(name)
        described = describe(self._work.trackers[name])
        if failure is not None:
            return TrackerResult(
                name=name,
                describe=described,
                failed=failure,
                metrics=no_metrics("the tracker failed", self._work.metrics),
                health=Health(non_finite_estimates=int(failure.cause == NOT_FINITE)),
            )
        evaluation = self.found.evaluations[name]
        return TrackerResult(
            name=name,
            describe=described,
            failed=None,
            metrics=evaluation.values,
            health=health(self.found.scores[name]),
            breakdown=breakdown(evaluation.scores.classes),
            scene_share=self.found.scene_share(name),
        )

    def sensors(self) -> dict[str, SensorSummary]:
        """The sensors by name, with their share of detections."""
        found = {}
        for number, sensor in enumerate(self._work.scenes[0].sensors):
            detected = sum(block.detections[sensor.name].sum() for block in self._blocks)
            seen = sum(self._in_view(scene.sensors[number]) for scene in self._work.scenes)
            found[sensor.name] = sensor_summary(sensor, float(detected / seen) if seen > 0 else None)
        return found

    def _in_view(self, sensor: IdealSensor) -> float:
        """Number of instants, objects and runs of a scene at which the sensor could see the object."""
        return float(sensor.visible.mean(axis=-1).sum() * self._work.runs)

    def tables(self) -> dict[str, pa.Table]:
        """Every table by name."""
        work, run = self._work, self._work.recorded_run
        scene = work.scenes[work.recorded_scene]
        truth, instants = scene.truth, scene.instants()
        block = next(block for block in self._blocks if block.scans is not None)
        assert block.scans is not None
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
            "measurements": recorded_tables.measurements_table(block.scans, truth.ids),
            "estimates": recorded_tables.estimates_table(recorded, truth, instants, run),
            "recorded_nis": recorded_tables.recorded_nis_table(recorded, truth.ids, own),
            "roads": recorded_tables.roads_table(truth),
        }


def sensor_summary(sensor: IdealSensor, detection_rate: float | None) -> SensorSummary:
    """A sensor as it stands in a result."""
    return SensorSummary(
        kind=sensor.config.type,
        dof=len(sensor.noise_covariance),
        noise=_noise(sensor.config),
        fov_deg=sensor.config.fov_deg,
        max_range_m=sensor.config.max_range_m,
        mount=MountSummary.model_validate(sensor.config.mount.model_dump()),
        rate_hz=scan_rate(sensor),
        preset=sensor.config.preset,
        detection_rate=detection_rate,
    )


def _noise(sensor: Sensor) -> dict[str, ComponentNoise]:
    """Of each component, angles in degrees."""
    found = {}
    for name, unit, sigma in zip(sensor.components, sensor.units, sensor.sigmas(), strict=True):
        angle = unit == "rad"
        found[name] = ComponentNoise(sigma=math.degrees(sigma) if angle else sigma, unit="deg" if angle else unit)
    return found


def truth_summary(
    truths: Sequence[LoadedTruth], work: Work, sources: Sequence[TruthSource], errors: Mapping[str, Array]
) -> TruthSummary:
    """The truth as it stands in a result.

    Args:
        truths: of each scene.
        work: what was run.
        sources: of each scene.
        errors: by ranked tracker ``(scenes,)`` its error in each.
    """
    loaded = truths[work.recorded_scene]
    truth = loaded.truth
    entries = {
        "objects": list(truth.ids),
        "known": truth.known,
        "steps": len(truth.time),
        "dt": float(truth.time[1] - truth.time[0]) if len(truth.time) > 1 else None,
        "duration_s": float(truth.time[-1]),
        "audit": truth.audit,
        "cached": all(item.cached for item in truths),
        "scenes": _scenes(truths, sources, errors) if len(truths) > 1 else [],
    }
    return TruthSummary.model_validate({**truth.source, **entries})


def _scenes(
    truths: Sequence[LoadedTruth], sources: Sequence[TruthSource], errors: Mapping[str, Array]
) -> list[SceneSummary]:
    return [
        SceneSummary(
            name=source.scene_name or f"scene {number + 1}",
            objects=list(item.truth.ids),
            duration_s=float(item.truth.time[-1]),
            audit=item.truth.audit,
            error={name: float(each[number]) for name, each in errors.items() if np.isfinite(each[number])},
        )
        for number, (item, source) in enumerate(zip(truths, sources, strict=True))
    ]


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


def _log_broken(evaluations: Mapping[str, Evaluation]) -> None:
    """Say once of each metric that it raised."""
    broken = {metric: cause for item in evaluations.values() for metric, cause in item.broken.items()}
    for metric, cause in broken.items():
        log.warning("metric %s has no value: %s", metric, cause)
