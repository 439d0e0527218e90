"""What every result says of its scenario, whether identities are known or hidden."""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version

import numpy as np

from trackbench.base.types import Array
from trackbench.engine.equations import ComputedBy
from trackbench.metrics import Metric
from trackbench.models.sensors import Sensor
from trackbench.results import Summary, TrackerResult
from trackbench.results.scenario_summary import (
    ComponentNoise,
    MountSummary,
    ReferenceSummary,
    ScenarioSummary,
    SceneSummary,
    SensorSummary,
    TruthSummary,
)
from trackbench.results.score_summary import MarginSummary, MetricSummary, ScoreSummary
from trackbench.results.summary import Difference, ExpectationResult
from trackbench.runner.block import Block
from trackbench.runner.work import Work
from trackbench.scenario import Scenario
from trackbench.sensing.scans import IdealSensor, scan_rate
from trackbench.truth import LoadedTruth, TruthSource

PACKAGES = ("trackbench", "highway-env", "gymnasium", "numpy", "scipy", "rerun-sdk")


def summarised(
    loaded: Scenario,
    truths: Sequence[LoadedTruth],
    work: Work,
    blocks: Sequence[Block],
    command: str,
    *,
    errors: Mapping[str, Array],
    detected: Mapping[str, float],
    reference: ReferenceSummary | None,
    engine: ComputedBy,
    common_share: float | None,
    metrics: list[MetricSummary],
    trackers: list[TrackerResult],
    ranking: list[str],
    differences: list[Difference],
    expectations: list[ExpectationResult],
) -> Summary:
    """The summary of a run, from what all results say and the fields that differ.

    Args:
        errors: by ranked tracker ``(scenes,)`` its error in each.
        detected: by sensor, its number of detections.
        reference: None where identities are hidden.
        engine: that computed the trackers.
    """
    scenario = loaded.config
    instants = [scene.truth.time[scene.instants()] for scene in work.scenes]
    return Summary(
        identities=scenario.sensing.identities,
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
        engine=engine,
        command=command,
        fingerprints=[digest.hex()[:16] for block in blocks for digest in block.digests],
        truth=_truth(truths, work, scenario.truth.scenes(), errors),
        sensors=_sensors(work, detected),
        reference=reference,
        score=ScoreSummary(
            settle_s=work.settle,
            divergence_m=work.divergence,
            lost_after_s=work.lost_after,
            min_coverage=work.min_coverage if reference else 0.0,
            common_share=common_share,
            cutoff_m=work.cutoff,
            from_s=min(float(time[0]) for time in instants),
            to_s=max(float(time[-1]) for time in instants),
            margin=MarginSummary(**scenario.score.margin.model_dump()),
            metrics=metrics,
        ),
        recorded_run=work.number(work.recorded_scene, work.recorded_run),
        trackers=trackers,
        ranking=ranking,
        differences=differences,
        expectations=expectations,
        passed=all(item.passed for item in expectations),
        artifacts={},
    )


def summary_of_metric(metric: Metric) -> MetricSummary:
    """What a result says of a metric."""
    return MetricSummary(
        name=metric.name,
        unit=metric.unit,
        meaning=metric.meaning,
        better=metric.better,
        compared=metric.compared and metric.better is not None,
        per_sensor=metric.per_sensor,
        options=metric.model_dump(mode="json", fallback=str),
    )


def _sensors(work: Work, detected: Mapping[str, float]) -> dict[str, SensorSummary]:
    """The sensors by name, with their share of detections of the objects in view, over instants, objects and runs."""
    found = {}
    for number, sensor in enumerate(work.scenes[0].sensors):
        seen = sum(float(scene.sensors[number].visible.mean(axis=-1).sum() * work.runs) for scene in work.scenes)
        found[sensor.name] = _sensor(sensor, float(detected[sensor.name] / seen) if seen > 0 else None)
    return found


def _sensor(sensor: IdealSensor, detection_rate: float | None) -> SensorSummary:
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
        latency_s=sensor.config.latency,
    )


def _noise(sensor: Sensor) -> dict[str, ComponentNoise]:
    """Of each component, angles in degrees."""
    found = {}
    for name, unit, sigma in zip(sensor.components, sensor.units, sensor.sigmas(), strict=True):
        angle = unit == "rad"
        found[name] = ComponentNoise(sigma=math.degrees(sigma) if angle else sigma, unit="deg" if angle else unit)
    return found


def _truth(
    truths: Sequence[LoadedTruth], work: Work, sources: Sequence[TruthSource], errors: Mapping[str, Array]
) -> TruthSummary:
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
